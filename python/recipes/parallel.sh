#!/usr/bin/env bash
# A fleet with GNU parallel: parallel.sh LOGS OUT [CONFIG]. Logs are handed out eight at a time; run it again to go on
# where it was stopped. Then `python -m hmd.fleet LOGS -o OUT --workers 0` writes table and report.
set -euo pipefail
logs=$1 out=$2 config=${3:+--config=$3}

# Which files are logs, as `python -m hmd.fleet` chooses them.
python3 - "$logs" "$out" "${3:-}" <<'PYTHON' |
import sys
from pathlib import Path

from hmd.fleet import Job, find_logs

logs, out, config = (Path(word) if word else None for word in sys.argv[1:])
for log in find_logs(logs, Job.prepared(out, config, 1)).logs:
    print(log, end="\0")
PYTHON
    parallel --null --max-args 8 --halt never --no-notice \
        python3 -m hmd.fleet.one --output="$out" ${config:+"$config"} {}
