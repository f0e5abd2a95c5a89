#!/usr/bin/env bash
# A fleet with GNU parallel: parallel.sh LOGS OUT [CONFIG]. Logs are handed out eight at a time; run it again to go on
# where it was stopped. Then `python -m hmd.fleet LOGS -o OUT --workers 0` writes table and report.
set -euo pipefail
logs=$1 out=$2 config=${3:+--config=$3}

find "$logs" -type f \( -name '*.mcap' -o -name '*.log' \) -print0 |
    sort -z |
    parallel --null --max-args 8 --halt never --no-notice \
        python3 -m hmd.fleet.one --output="$out" ${config:+"$config"} {}
