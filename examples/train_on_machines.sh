#!/usr/bin/env bash
# Train on several machines. Run it on each of them, at about the same time:
#
#   MASTER=10.0.0.5 NODES=2 examples/train_on_machines.sh data --out runs/depth --modality depth ...
#
# The words after the script are those of `perceptree train`. MASTER is the address of one of the
# machines, which the others reach. All must see the same data under the same path; the machine of
# the process of rank 0 writes the run. If a machine fails, all end: start all again, with the same
# words, and the training goes on from its last state.
#
# PROCESSES is the number of processes of this machine: one per GPU, or 1 on processors.
# On Slurm: srun --nodes=2 --ntasks-per-node=1 examples/train_on_machines.sh data --out ..., which
# knows MASTER and NODES by itself.
set -euo pipefail

if [[ -n ${SLURM_JOB_NODELIST:-} ]]; then
    MASTER=${MASTER:-$(scontrol show hostnames "$SLURM_JOB_NODELIST" | head -n 1)}
    NODES=${NODES:-$SLURM_NNODES}
fi
: "${MASTER:?is not set: expected the address of one of the machines, such as 10.0.0.5}"
: "${NODES:?is not set: expected the number of machines, such as 2}"

exec "${PYTHON:-python}" -m torch.distributed.run \
    --nnodes="$NODES" \
    --nproc-per-node="${PROCESSES:-1}" \
    --rdzv-backend=c10d \
    --rdzv-endpoint="$MASTER:${PORT:-29400}" \
    --rdzv-id="${SLURM_JOB_ID:-edgetree}" \
    -m perceptree train "$@"
