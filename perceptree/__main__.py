"""``python -m perceptree``, and ``torchrun -m perceptree``: the command line."""

from perceptree.cli import main

if __name__ == "__main__":
    main()
