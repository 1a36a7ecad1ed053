"""Files that are either whole or not there: everything is written beside its place and then moved into it."""
import contextlib
import csv
import io
import json
import os
import re
from xml.sax.saxutils import quoteattr


@contextlib.contextmanager
def replacing(path):
    """Yields a temporary name in the same folder; it takes the place of `path` when the block ends well."""
    root, extension = os.path.splitext(path)
    temporary = f"{root}.{os.getpid()}.part{extension}"
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        error.filename = path  # a disk that is full does not say where
        raise
    finally:
        remove(temporary)


def remove(path):
    """Removes a file that may not be there."""
    with contextlib.suppress(FileNotFoundError):
        os.remove(path)


def remove_parts(folder):
    """Removes what a killed process has left half written, everywhere in the folder."""
    for parent, _, names in os.walk(folder):
        for name in names:
            if re.search(r"\.\d+\.part(\.\w+)?$", name):
                os.remove(os.path.join(parent, name))


def reason(error):
    """An OSError as a line for people."""
    return f"{error.strerror or error}: {error.filename or ''}".rstrip(": ")


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
    lines = [f'  <DataSet timestep="{time!r}" file={quoteattr(name)}/>' for time, name in entries]
    write_text(path, "\n".join(['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', " <Collection>", *lines,
                                " </Collection>", "</VTKFile>", ""]))


def space_before_appended_data(path):
    """Puts white space between the tag <AppendedData> of a VTK XML file and its data, in place: more than VTK's parser reads at once.

    VTK 9.2 hands a file to expat in pieces of 4096 bytes, stops at that tag, and closes the document itself. An expat that puts off
    half-read tags (2.6 and later, Debian's 2.5.0 from deb12u2 on) does not report the tag then; VTK does not notice, and hands it the
    next piece: binary data, "not well-formed". White space is legal there and makes expat report the tag; every VTK skips it.
    """
    tag, piece = b'<AppendedData encoding="raw">', 4096
    with open(path, "r+b") as f:
        content = f.read()
        at = content.index(tag) + len(tag)
        f.seek(at)
        f.write(b" " * (piece + -at % piece))
        f.write(memoryview(content)[at:])
