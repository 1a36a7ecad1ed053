"""Checks the pages (*.md): relative links and their anchors lead somewhere, and the tables of properties are those of the plugin's XML.

python3 Testing/Style/check_pages.py [--update]    --update rewrites the tables, between <!-- properties:PROXY --> and <!-- /properties -->
"""
import pathlib
import re
import subprocess
import sys
import unittest
import urllib.parse
import xml.etree.ElementTree as ElementTree

SOURCE = pathlib.Path(__file__).resolve().parents[2]
TABLE = re.compile(r"(<!-- properties:(\w+) -->\n)(.*?)(<!-- /properties -->)", re.DOTALL)
LINK = re.compile(r"!?\[[^\]\n]*\]\(\s*<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\s*\)|(?:src|href)=\"([^\"]+)\"")


def pages():
    names = subprocess.run(["git", "ls-files", "-co", "--exclude-standard", "*.md"], cwd=SOURCE, capture_output=True, text=True)
    found = names.stdout.split() if names.returncode == 0 else [p.relative_to(SOURCE) for p in SOURCE.rglob("*.md") if "build" not in p.parts[len(SOURCE.parts)]]
    return [SOURCE / name for name in found if (SOURCE / name).exists()]


def prose(text):
    """Without code, in which brackets are no links: blocks between fences, indented ones, and what stands between backticks."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^(?: {4}|\t)(?!\s*(?:[-*]|\d+\.)\s).*$", "", text, flags=re.MULTILINE)
    return re.sub(r"`[^`\n]*`", "", text)


def anchors(text):
    """The anchors of the headings, as GitHub makes them, and those that stand there as HTML."""
    found, seen = set(re.findall(r'<a (?:id|name)="([^"]+)"', text)), {}
    for heading in re.findall(r"^#{1,6}\s+(.+?)\s*#*$", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE), re.MULTILINE):
        heading = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        name = re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
        found.add(f"{name}-{seen[name]}" if name in seen else name)
        seen[name] = seen.get(name, 0) + 1
    return found


def dead_links(page):
    """[(link, what is wrong)]"""
    dead = []
    for first, second in LINK.findall(prose(page.read_text(encoding="utf-8"))):
        link = first or second
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = urllib.parse.unquote(link).partition("#")
        target = (page.parent / path).resolve() if path else page
        if not target.exists():
            dead.append((link, "there is no such file"))
        elif anchor and target.suffix == ".md" and anchor not in anchors(target.read_text(encoding="utf-8")):
            dead.append((link, f"there is no such heading in {target.name}"))
    return dead


def literals():
    """All texts in the sources, with those that are written in pieces put together; what is inserted in between becomes '...'."""
    texts = []
    for pattern in ("Filters/**/*.cxx", "Filters/**/*.h", "Readers/*.cxx", "Readers/*.h", "Python/rimflow/*.py", "rimflow"):
        for path in sorted(SOURCE.glob(pattern)):
            text = path.read_text(encoding="utf-8")
            text = re.sub(r"\"\s*\n?\s*f?\"", "", text)  # "a" "b", and f"a" f"b" in Python
            texts.append(re.sub(r"\{[^{}\n]*\}", "...", text) if path.suffix == ".py" else text)
    return "\n".join(texts)


def unknown_messages(page, sources):
    """What stands in italics in the first column of the page's tables and is in no source; '...' stands for anything."""
    missing = []
    for line in page.read_text(encoding="utf-8").splitlines():
        cell = line.split("|")[1] if line.startswith("| *") else ""
        if "(ParaView's)" in cell:
            continue
        for message in re.findall(r"\*([^*]+)\*", cell):
            missing += [piece for piece in re.split(r"\s*\.\.\.\s*", message) if len(piece) > 8 and piece not in sources]
    return missing


def proxy(name):
    for path in sorted((SOURCE / "ServerManager").glob("*.xml")):
        for found in ElementTree.parse(path).getroot().iter():
            if found.get("name") == name and found.tag.endswith("Proxy"):
                return found
    raise KeyError(f"there is no proxy {name} in ServerManager")


def sentence(element):
    text = element.find("Documentation")
    return " ".join((text.text or "").split()).replace("|", "\\|") if text is not None else ""


def default(element):
    """As the panel shows it: the entry's text, on or off, or the numbers."""
    value = element.get("default_values")
    for entry in element.iter("Entry"):
        if entry.get("value") == value:
            return entry.get("text")
    if element.find("BooleanDomain") is not None:
        return "on" if value == "1" else "off"
    if value is None or element.find("ArrayListDomain") is not None:
        return ""
    return value.replace(" ", ", ")


def property_table(name):
    lines = ["| property | default | meaning |", "| --- | --- | --- |"]
    for element in proxy(name):
        hidden = element.get("panel_visibility") == "never" or element.get("information_only") == "1"
        if not element.tag.endswith("Property") or element.tag in ("InputProperty", "StringVectorProperty") and element.find("ArrayListDomain") is None:
            continue
        if hidden or element.get("name") == "TimestepValues":
            continue
        label = element.get("label") or element.get("name")
        mark = " &#9881;" if element.get("panel_visibility") == "advanced" else ""
        lines.append(f"| *{label}*{mark} | {default(element)} | {sentence(element)} |")
    return "\n".join(lines) + "\n"


def with_tables(text):
    return TABLE.sub(lambda m: m.group(1) + property_table(m.group(2)) + m.group(4), text)


class TestPages(unittest.TestCase):
    def test_no_link_is_dead(self):
        found = pages()
        self.assertGreater(len(found), 10)
        dead = [f"{page.relative_to(SOURCE)}: {link}: {why}" for page in found for link, why in dead_links(page)]
        self.assertFalse(dead, "\n" + "\n".join(dead))

    def test_every_picture_is_shown_and_its_maker_is_named(self):
        images = SOURCE / "Documentation" / "images"
        texts = {page: page.read_text(encoding="utf-8") for page in pages()}
        shown = {(page.parent / link).resolve() for page, text in texts.items() for pair in LINK.findall(text) for link in pair if link}
        makers = texts[SOURCE / "Documentation" / "developer-guide.md"]
        for picture in images.glob("**/*.png"):
            self.assertTrue(picture in shown, f"no page shows {picture.name}")
            entry = picture.name if picture.parent == images else f"{picture.parent.name}/"
            if not picture.name.startswith("gui"):
                self.assertTrue(f"`{entry}`" in makers, f"the developer guide does not say who makes {entry}")

    def test_the_tables_of_properties_are_those_of_the_plugin(self):
        tables = 0
        for page in pages():
            text = page.read_text(encoding="utf-8")
            tables += len(TABLE.findall(text))
            self.assertEqual(text, with_tables(text), f"run python3 Testing/Style/check_pages.py --update for {page.name}")
        self.assertGreater(tables, 5)

    def test_the_messages_are_those_of_the_sources(self):
        self.assertFalse(unknown_messages(SOURCE / "Documentation" / "messages.md", literals()))

    def test_a_dead_link_is_noticed(self):
        self.assertEqual(anchors("# What's new?\n## A `b` (c)\n## A `b` (c)"), {"whats-new", "a-b-c", "a-b-c-1"})
        page = SOURCE / "README.md"
        self.assertEqual(LINK.findall('[a](x.md#b) ![c](<d.png>) <img src="e.png">'), [("x.md#b", ""), ("d.png", ""), ("", "e.png")])
        self.assertNotIn("[", prose("    [a](b)\n`[c](d)`\n```\n[e](f)\n```\n"))
        self.assertTrue(page.exists())


if __name__ == "__main__":
    if "--update" in sys.argv:
        for changed in pages():
            changed.write_text(with_tables(changed.read_text(encoding="utf-8")), encoding="utf-8")
    else:
        unittest.main(verbosity=2)
