#!/usr/bin/python3
"""Intersection over union of the dark parts of two pictures, the second as large or a whole number of
times as large (pixels are then averaged): iou.py coarse.png fine.png. Needs python3-pil, python3-numpy."""

import sys

import numpy
from PIL import Image


def read(path):
    return numpy.asarray(Image.open(path).convert("L"), dtype=float)


def main(coarse_path, fine_path):
    coarse, fine = read(coarse_path), read(fine_path)
    rows, columns = coarse.shape
    times = fine.shape[0] // rows
    if times < 1 or fine.shape[1] // columns != times:
        sys.exit(f"{fine_path} is {fine.shape}, no whole number of times {coarse_path}'s {coarse.shape}")
    fine = fine[: times * rows, : times * columns]
    fine = fine.reshape(rows, times, columns, times).mean(axis=(1, 3))
    a, b = coarse < 128, fine < 128
    if not (a | b).any():
        sys.exit("both pictures are blank")
    print(f"{(a & b).sum() / (a | b).sum():.3f}")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
