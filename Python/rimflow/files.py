"""Files that are either whole or not there: everything is written beside its place and then moved into it."""
import contextlib
import csv
import io
import json
import os


@contextlib.contextmanager
def replacing(path):
    """Yields a temporary name in the same folder; it takes the place of `path` when the block ends well."""
    root, extension = os.path.splitext(path)
    temporary = f"{root}.{os.getpid()}.part{extension}"
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        with contextlib.suppress(FileNotFoundError):
            os.remove(temporary)


def write_text(path, text):
    with replacing(path) as temporary:
        with open(temporary, "w", encoding="utf-8", newline="\n") as f:
            f.write(text)
            f.flush()
            os.fsync(f.fileno())


def write_json(path, data):
    write_text(path, json.dumps(data, indent=1, allow_nan=False) + "\n")


def write_csv(path, columns, rows):
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    write_text(path, text.getvalue())


def write_pvd(path, entries):
    """entries: (time in s, file name relative to the .pvd). ParaView opens the result as a time series."""
    lines = [f'  <DataSet timestep="{time!r}" file="{name}"/>' for time, name in entries]
    write_text(path, "\n".join(['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', " <Collection>", *lines,
                                " </Collection>", "</VTKFile>", ""]))
