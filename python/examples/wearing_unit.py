"""From healthy logs of one actuator to what wears, in data frames and on a page."""

from datetime import UTC, datetime
from pathlib import Path

import pandas

import hmd

folder = Path("wearing-unit")
folder.mkdir(exist_ok=True)

# Recordings: healthy ones to commission the unit by, and one a month later. Yours take their place.
installed, later = (datetime(2026, month, 20, 14, tzinfo=UTC) for month in (10, 11))
hmd.simulate(folder / "healthy.log", windows=8, start=installed, rate_hz=400, noise_a=0.03, seed=1)
hmd.simulate(folder / "later.log", faults={"friction": 0.3}, windows=3, start=later, rate_hz=400, noise_a=0.03, seed=2)

config = folder / "hmd.toml"
config.write_text('[[actuator]]\nid = 0\nname = "flap-left"\ncalibration = "flap-left.toml"\n')
for sentence in hmd.calibrate(folder / "healthy.log", folder / "flap-left.toml", config=config):
    print(sentence)

found = hmd.replay(folder / "later.log", config=config, output=folder / "later.mcap")
print(found)

frame: pandas.DataFrame = found.to_pandas()
named = dict(zip((f"k{n}" for n in range(1, 9)), hmd.FAULT_PARAMETERS, strict=True))
print(frame[["window", "status", "health", *named]].rename(columns=named).round(3).to_string(index=False))

hmd.report(folder / "later.mcap", folder / "flap-left.html", config=config)
