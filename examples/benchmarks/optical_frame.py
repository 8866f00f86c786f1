"""Measure the optical sensor: time per picture, and error of a touch.

python examples/benchmarks/optical_frame.py [--output optical_frame]

Writes <output>.csv, a row per rendered touch (320 x 240 px, a disc of 236 px), and
<output>.png.  Times are CPU seconds on one thread, medians of all pictures.  The errors
hold for rendered texture only; on real texture the error of the centre of pressure is 5
to 40 times larger (hardware/README.md).
"""

import argparse
import math
from itertools import product
from time import process_time

import cv2
import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot as plt
from study import one_thread, write_csv

from hardware.optical import Lens, OpticalTouch
from hardware.simulated_skin import SimulatedSkin

SHAPE = (240, 320)  # [px]
LENS = Lens(centre=(160.0, 120.0), edge=118.0)
POLARS = (0, 15, 30, 45, 60, 70)  # [deg] off the dome's axis
FORCES = (0.2, 0.5, 1.0, 2.0)  # [N]
AROUND = 4  # touches about the axis
BUDGET = 16.0  # [ms]: two sensors at 30 Hz
NONE = [float("nan")]  # nothing was felt there


def direction(polar: float, azimuth: float) -> np.ndarray:
    """Return the dome's normal (3,) at angles [rad]."""
    s = math.sin(polar)
    return np.array(
        [s * math.cos(azimuth), s * math.sin(azimuth), math.cos(polar)], float
    )


def touches(skin: SimulatedSkin, sensor: OpticalTouch) -> list[dict]:
    """Return a row for every rendered touch."""
    rows, turns = [], np.linspace(0.3, 2 * np.pi + 0.3, AROUND, endpoint=False)
    for polar, force, azimuth in product(POLARS, FORCES, turns):
        push = direction(math.radians(polar), azimuth)
        picture = skin.picture(push, force)
        began = process_time()
        sensed = sensor.sense(picture)
        seconds = process_time() - began
        found = LENS.direction(sensed.centre)
        rows.append({
            "polar_deg": polar, "force_N": force,
            "centre_px": np.linalg.norm(sensed.centre - LENS.pixel(push)),
            "normal_deg": np.degrees(np.arccos(min(found @ push, 1.0))),
            "strength": sensed.strength,
            "felt": int(sensed.strength > sensor.decide.on), "ms": 1e3 * seconds,
        })  # fmt: skip
    return rows


def draw(path: str, rows: list[dict], skin: SimulatedSkin, sensor: OpticalTouch):
    """Save a picture: one touch as it is seen, its pressure, and all errors."""
    figure, (seen, pressed, errors) = plt.subplots(1, 3, figsize=(12, 3.6))
    push = direction(math.radians(35), 0.8)
    picture = skin.picture(push, 2.0)
    sensed = sensor.sense(picture)
    for axes, image, title in (
        (seen, picture, "a touch of 2 N"),
        (pressed, sensed.pressure, "pressure -psi [px$^2$]"),
    ):
        axes.imshow(image, cmap="gray" if axes is seen else "viridis")
        axes.set_title(title)
        axes.axis("off")
    seen.plot(*LENS.pixel(push), "o", mfc="none", mec="tab:green", ms=12, label="true")
    seen.plot(*sensed.centre, "+", color="tab:red", ms=12, label="found")
    seen.legend(loc="lower right")
    for force in FORCES:
        some = [row for row in rows if row["force_N"] == force and row["felt"]]
        medians = [
            np.median(
                [r["normal_deg"] for r in some if r["polar_deg"] == polar] or NONE
            )
            for polar in POLARS
        ]
        errors.plot(POLARS, medians, "o-", label=f"{force:g} N")
    errors.set(xlabel="touch off the axis [deg]", ylabel="normal off [deg]")
    errors.legend()
    figure.tight_layout()
    figure.savefig(path, dpi=120)


def main() -> None:
    """Render, sense, write and print."""
    one_thread()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", default="optical_frame")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    skin, sensor = SimulatedSkin(LENS, SHAPE), OpticalTouch(LENS)
    sensor.learn([skin.picture() for _ in range(30)])
    false = [sensor.sense(skin.picture()).strength for _ in range(30)]
    rows = touches(skin, sensor)
    write_csv(f"{options.output}.csv", rows)
    draw(f"{options.output}.png", rows, skin, sensor)
    felt = [row for row in rows if row["felt"] and row["polar_deg"] <= 60]
    centre = np.median([row["centre_px"] for row in felt])
    normal = np.median([row["normal_deg"] for row in felt])
    ms = np.median([row["ms"] for row in rows])
    print(f"felt {sum(row['felt'] for row in rows)} of {len(rows)} touches")
    print(
        f"within 60 deg: centre {centre:.2f} px, normal {normal:.2f} deg off (median)"
    )
    on, most = sensor.decide.on, max(false)
    print(f"threshold {on:.1f} px^2, largest without a touch {most:.2f} px^2")
    print(f"{ms:.1f} ms CPU per picture, budget {BUDGET:g} ms.")


if __name__ == "__main__":
    main()
