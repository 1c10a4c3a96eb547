#!/usr/bin/python3
"""The tip of a brush at three levels of ink, in the air and pressed by 10 mm: tips.py BRUSH OUT.png.

Runs validate, which must be on the path, and draws the outlines of its SVG files side by side, at 16 px/mm.
Needs python3-pil.
"""
import os
import re
import subprocess
import sys
import tempfile

from PIL import Image, ImageDraw

INKS = ["0", "0.03", "1"]
DEPTHS = ["0", "0.01"]  # [m]
PX_PER_MM = 16
FINER = 4  # drawn so much finer, then made smaller
GAP = 48  # [px]


def draw(path):
    with open(path) as file:
        text = file.read()
    width, height = (float(size) for size in re.search(r'viewBox="0 0 (\S+) (\S+)"', text).groups())
    scale = PX_PER_MM * FINER
    picture = Image.new("L", (round(scale * width), round(scale * height)), 255)
    pen = ImageDraw.Draw(picture)
    for outline in re.findall(r' d="([^"]*)"', text):
        numbers = [scale * float(number) for number in re.findall(r"[-\d.]+", outline)]
        pen.polygon(list(zip(numbers[::2], numbers[1::2])), fill=0)
    return picture.resize((picture.width // FINER, picture.height // FINER), Image.LANCZOS)


def main(brush, out):
    parts = []
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "tip.svg")
        for depth in DEPTHS:
            for ink in INKS:
                subprocess.run(["validate", "tip_shape", "--brush", brush, "--ink", ink, "--depth", depth,
                                "--picture", path], check=True, stdout=subprocess.DEVNULL)
                parts.append(draw(path))
    width = sum(part.width for part in parts) + GAP * (len(parts) - 1)
    picture = Image.new("L", (width, max(part.height for part in parts)), 255)
    left = 0
    for part in parts:
        picture.paste(part, (left, 0))
        left += part.width + GAP
    picture.save(out, optimize=True)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
