"""check_help.py BUILD: breaks when ParaView's help (the button "?" of a panel) lacks a page for a proxy, or a page lacks a property or shows wrong characters."""
import html
import pathlib
import re
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
                page = (FOLDER / name).read_text()
                self.assertTrue(html.unescape(page).isascii(), f"{name}: the help window reads it as Latin-1")
                for prop in proxy.iter():
                    if prop.tag.endswith("Property") and prop.get("label") and prop.get("panel_visibility") != "never":
                        self.assertRegex(page, rf"<th>\s*{re.escape(html.escape(prop.get('label')))}\s*</th>", name)


if __name__ == "__main__":
    unittest.main()
