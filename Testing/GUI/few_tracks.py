"""few_tracks.py OUT: a part of the demo's tracks, so that a test which clicks takes seconds: snapshots 6 to 8, every third track."""
import gzip
import pathlib
import re
import sys

FIRST, LAST, STRIDE, TRACK_ID = 6, 8, 3, 8  # TRACK_ID: the column

text = gzip.decompress((pathlib.Path(__file__).parents[2] / "Examples" / "demo" / "sphere.dat.gz").read_bytes()).decode("latin-1")
header, *zones = re.split(r"(?m)^(?=ZONE )", text)
with open(sys.argv[1], "w", encoding="latin-1") as out:
    out.write(header)
    for zone in zones[FIRST:LAST + 1]:
        name, time, _, packing, *rows = zone.splitlines()
        rows = [row for row in rows if int(row.split()[TRACK_ID]) % STRIDE == 0]
        out.write("\n".join([name, time, f"I={len(rows)}, J=1, K=1, ZONETYPE = Ordered", packing, *rows, ""]))
