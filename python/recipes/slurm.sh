#!/usr/bin/env bash
#SBATCH --array=0-99
#SBATCH --cpus-per-task=1
#SBATCH --mem=1G
#SBATCH --requeue
# A fleet as a Slurm array: sbatch slurm.sh LOGS OUT [CONFIG]. Task I of N takes every N-th log from the I-th on; a task that
# is requeued skips what it had done. Then, as a job with --dependency=afterany on this one,
# `python -m hmd.fleet LOGS -o OUT --workers 0` writes table and report.
set -euo pipefail
logs=$1 out=$2 config=${3:+--config=$3}

exec python3 -m hmd.fleet.one --output="$out" ${config:+"$config"} \
    --task "$SLURM_ARRAY_TASK_ID" --of "$SLURM_ARRAY_TASK_COUNT" "$logs"
