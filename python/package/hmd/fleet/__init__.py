"""A fleet's logs, each assessed once, on whatever runs programs.

The contract (`contract`): one log in, one result out, named by what it is made of, written whole or not at all. Who
keeps it may run anything, anywhere, again: `python -m hmd.fleet` with Dask, `python -m hmd.fleet.one` under Slurm, GNU
parallel or a loop of a shell. `docs/fleet.md` of the repository describes it.
"""

from .contract import Found, Job, Outcome, PassedOver, find_logs, one_log

__all__ = ["Found", "Job", "Outcome", "PassedOver", "find_logs", "one_log"]
