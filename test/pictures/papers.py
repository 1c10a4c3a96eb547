#!/usr/bin/python3
"""The same stroke on every sheet, one above the other: papers.py STROKE.yaml OUT.png [LOAD].

Runs stroke_writer and stroke_replay, which must be on the path, at 8 px/mm; LOAD is the ink in the brush
(default 1). Shown at 4 px/mm with each sheet's own tint. Needs python3-pil.
"""
import os
import subprocess
import sys
import tempfile

from PIL import Image, ImageDraw

PAPERS = ["copy", "xuan_sized", "plain", "hanshi", "washi", "xuan_raw"]
HEIGHT = 136  # of a sheet's part [px]


def main(strokes, out, load="1"):
    parts = []
    with tempfile.TemporaryDirectory() as folder:
        brush = os.path.join(folder, "brush.yaml")
        with open(brush, "w") as file:
            file.write("ink: {load: %s}\n" % load)
        bag = os.path.join(folder, "strokes.bag")
        subprocess.check_call(["stroke_writer", strokes, "--brush", brush, "--bag", bag, "--quiet"])
        for paper in PAPERS:
            # Its own kind, on a sheet of the size that the stroke file is for.
            sheet = os.path.join(os.path.dirname(__file__), "..", "..", "config", "papers", paper + ".yaml")
            with open(sheet) as file:
                lines = [line for line in file if line.split(":")[0].strip() not in ("width", "height")]
            sheet = os.path.join(folder, paper + ".yaml")
            with open(sheet, "w") as file:
                file.writelines(lines + ["  width: 0.3\n", "  height: 0.3\n"])
            picture = os.path.join(folder, paper + ".png")
            subprocess.check_call(["stroke_replay", bag, picture, "--brush", brush, "--paper", sheet,
                                   "--px-per-mm", "8", "--format", "colour", "--quiet"])
            image = Image.open(picture).convert("RGB")
            middle = image.height // 2
            image = image.crop((240, middle - HEIGHT - 24, image.width - 160, middle + HEIGHT - 24))
            image = image.resize((image.width // 2, image.height // 2), Image.LANCZOS)
            ImageDraw.Draw(image).text((8, image.height - 16), paper, fill=(90, 70, 50))
            parts.append(image)
    whole = Image.new("RGB", (parts[0].width, sum(part.height for part in parts)))
    top = 0
    for part in parts:
        whole.paste(part, (0, top))
        top += part.height
    whole.save(out)


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    main(*sys.argv[1:])
