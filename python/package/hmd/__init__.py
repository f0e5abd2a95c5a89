"""Health monitoring of electromechanical actuators.

The functions here run the code of the program `hmd` itself, so they give what the program gives, to the last bit:

- `replay` assesses recorded logs, `identify` samples in arrays;
- `read_raw` and `read_records` read logs, and what `hmd` wrote, into Arrow tables (`pyarrow.Table`), with the unit of
  each column in its field's metadata;
- `calibrate`, `check_config`, `report`, `export` and `simulate` do what the verbs of those names do;
- `hmd.fleet` does a folder of logs on many cores or computers.

Every name of a quantity ends with its unit. What the program would say in one sentence is the text of an `Error`.
"""

from . import _hmd
from ._assessed import Judged, identify, replay
from ._hmd import VERSION as __version__
from ._hmd import ConfigError, Error, UsageError
from ._tables import DataLossWarning, read_raw, read_records
from ._verbs import calibrate, check_config, export, report, simulate

FAULT_PARAMETERS: tuple[str, ...] = tuple(_hmd.FAULT_PARAMETERS)
"""Names of `k1` to `k8`, in that order."""

__all__ = [
    "FAULT_PARAMETERS",
    "ConfigError",
    "DataLossWarning",
    "Error",
    "Judged",
    "UsageError",
    "__version__",
    "calibrate",
    "check_config",
    "export",
    "identify",
    "read_raw",
    "read_records",
    "replay",
    "report",
    "simulate",
]
