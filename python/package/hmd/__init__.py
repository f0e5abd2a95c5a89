"""Health monitoring of electromechanical actuators.

The functions here run the code of the program `hmd` itself, so they give what the program gives, to the last bit:

- `replay` assesses recorded logs, `identify` samples in arrays;
- `read_raw` and `read_records` read logs, and what `hmd` wrote, into Arrow tables (`pyarrow.Table`), with the unit of
  each column in its field's metadata;
- `simulate` writes a log of the reference model;
- `hmd.fleet` does a folder of logs on many cores or computers.

Every name of a quantity ends with its unit. What the program would say in one sentence is the text of an `Error`.
"""

from ._assessed import Judged, identify, replay
from ._hmd import VERSION as __version__
from ._hmd import ConfigError, Error, UsageError
from ._simulate import simulate
from ._tables import DataLossWarning, read_raw, read_records

__all__ = [
    "ConfigError",
    "DataLossWarning",
    "Error",
    "Judged",
    "UsageError",
    "__version__",
    "identify",
    "read_raw",
    "read_records",
    "replay",
    "simulate",
]
