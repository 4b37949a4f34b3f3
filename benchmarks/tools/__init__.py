"""What the programs share: command line and result file, timing, processes, trainings, plots."""
