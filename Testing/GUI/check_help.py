"""check_help.py BUILD: breaks when ParaView's help (the button "?" of a panel) lacks a page for a proxy, or a page lacks a property or shows wrong characters."""
import html
import pathlib
import sqlite3
import sys
import unittest
import xml.etree.ElementTree

FOLDER = pathlib.Path(sys.argv.pop()) / "ServerManager" / "paraview_help"
FILES = (pathlib.Path(__file__).parents[2] / "ServerManager").glob("*.xml")
GROUPS = [group for file in FILES for group in xml.etree.ElementTree.parse(file).getroot() if group.get("name") != "rimflow_internal"]


class TestHelp(unittest.TestCase):
    def test_every_proxy_has_a_page_with_every_property(self):
        collection = sqlite3.connect(FOLDER / "RIMFlow.qch")
        pages = {name for (name,) in collection.execute("SELECT Name FROM FileNameTable")}
        collection.close()
        self.assertGreaterEqual(sum(len(group) for group in GROUPS), 10)
        for group in GROUPS:
            for proxy in group:
                name = f"{group.get('name')}.{proxy.get('name')}.html"
                self.assertIn(name, pages)
                page = html.unescape((FOLDER / name).read_text())
                for prop in proxy.iter():
                    if prop.tag.endswith("Property") and prop.get("label") and prop.get("panel_visibility") != "never":
                        self.assertIn(prop.get("label"), page, name)

    def test_the_texts_are_ascii(self):
        for group in GROUPS:  # the help window reads the pages as Latin-1
            for element in group.iter("Documentation"):
                self.assertTrue((element.text or "").isascii() and (element.get("long_help") or "").isascii(), element.text)


if __name__ == "__main__":
    unittest.main()
