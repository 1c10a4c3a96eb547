#!/usr/bin/env python3
"""Picture of what work_precision measured: plot.py FILE.csv FILE.png (needs python3-matplotlib)."""
import csv
import sys
from collections import defaultdict

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

COLOURS = {"backward_euler": "#d95f02", "bdf2": "#1b6ca8", "sdirk2": "#2a9d55", "projection": "#777777"}
MARKERS = {8: "v", 10: "o", 16: "D", 20: "s", 32: "^", 64: "p"}
TITLES = {
    "release": "let go under gravity: error in time",
    "press": "pressed, at rest: against the continuous rod",
    "drag": "pressed and dragged: against the continuous rod",
    "slam": "slammed and dragged: against another scheme, converged",
}


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    with open(sys.argv[1], newline="") as file:
        rows = list(csv.DictReader(file))
    scenes = [scene for scene in TITLES if any(row["scene"] == scene for row in rows)]
    figure, axes = plt.subplots(2, 2, figsize=(11, 8.5))
    handles = {}
    for axis, scene in zip(axes.flat, scenes):
        lines = defaultdict(list)
        for row in rows:
            if row["scene"] == scene and row["error_mm"]:
                key = row["scheme"], row["precision"], int(row["nodes"])
                lines[key].append((float(row["us_per_rod_ms"]), float(row["error_mm"]), float(row["dt_ms"])))
        for (scheme, precision, nodes), points in lines.items():
            points.sort(key=lambda point: -point[2])
            colour, double = COLOURS[scheme], precision == "double"
            axis.plot([p[0] for p in points], [p[1] for p in points], color=colour, marker=MARKERS[nodes],
                      markersize=5, linewidth=1.0, linestyle="--" if double and scheme != "projection" else "-",
                      markerfacecolor="white" if double else colour)
            handles[scheme] = plt.Line2D([], [], color=colour, label=scheme)
            handles[f"n {nodes:3d}"] = plt.Line2D([], [], color="black", marker=MARKERS[nodes], linestyle="",
                                                  label=f"n = {nodes}")
            if scheme == "bdf2" and precision == "float":
                for x, y, dt in points:
                    if dt == 1.0:  # the default
                        axis.plot([x], [y], "o", markersize=13, markerfacecolor="none", color="black")
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_title(TITLES[scene], fontsize=10)
        axis.set_xlabel("processor time of a rod for 1 ms [µs]")
        axis.set_ylabel("error of the tip [mm]")
        axis.grid(True, which="both", alpha=0.2)
    legend = [handles[key] for key in sorted(handles)]
    legend.append(plt.Line2D([], [], color="black", label="float"))
    legend.append(plt.Line2D([], [], color="black", linestyle="--", label="double"))
    legend.append(plt.Line2D([], [], color="black", marker="o", markersize=12, markerfacecolor="none", linestyle="",
                             label="bdf2, 1 ms, float"))
    figure.legend(handles=legend, loc="lower center", ncol=6, fontsize=9, frameon=False)
    figure.tight_layout(rect=(0, 0.07, 1, 1))
    figure.savefig(sys.argv[2], dpi=90)


main()
