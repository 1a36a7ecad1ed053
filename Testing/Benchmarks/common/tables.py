"""Rows of a results.csv, Markdown tables made of them, and the page that shows these."""
import csv
import os
import re

import numpy as np


def numbers(rows, **wanted):
    return [r for r in rows if all(r[k] == v if isinstance(v, str) else abs(float(r[k]) - v) < 1e-9 for k, v in wanted.items())]


def mean(rows, column):
    return float(np.mean([float(r[column]) for r in rows])) if rows else np.nan


def unique(rows, column):
    return list(dict.fromkeys(r[column] for r in rows))


def markdown(head, lines):
    return "\n".join(["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)] + ["| " + " | ".join(line) + " |" for line in lines])


def between_marks(found):
    return "\n\n".join(f"<!-- table:{name} -->\n{text}\n<!-- /table:{name} -->" for name, text in found.items()) + "\n"


def fill(path, found):
    """Puts each table between its markers `<!-- table:NAME -->` and `<!-- /table:NAME -->`."""
    with open(path, encoding="utf-8") as f:
        text = f.read()
    for name, table in found.items():
        text, count = re.subn(rf"(<!-- table:{name} -->\n).*?(<!-- /table:{name} -->)", lambda m: m[1] + table + "\n" + m[2], text, flags=re.DOTALL)
        if count != 1:
            raise ValueError(f"{path} has {count} places for the table '{name}'; expected one: <!-- table:{name} --> ... <!-- /table:{name} -->")
    with open(path + ".new", "w", encoding="utf-8") as f:
        f.write(text)
    os.replace(path + ".new", path)


def write_rows(path, columns, rows):
    with open(path + ".new", "w", newline="") as f:
        writer = csv.DictWriter(f, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    os.replace(path + ".new", path)


def read_rows(path):
    """Those of an earlier run where this one makes none."""
    if not os.path.exists(path):
        return []
    with open(path, newline="") as f:
        return list(csv.DictReader(f))
