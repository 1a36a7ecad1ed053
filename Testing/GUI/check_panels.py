"""Breaks when a proxy of the plugin lacks what a newcomer needs: a sentence for every property, labelled groups, help in short and in long, an entry
with an icon in the menu RIMFlow (or the files that it opens), a label from which pvpython makes the public name."""
import pathlib
import unittest
import xml.etree.ElementTree

FILES = sorted((pathlib.Path(__file__).parents[2] / "ServerManager").glob("*.xml"))
PROXIES = [(file.name, group.get("name"), proxy) for file in FILES for group in xml.etree.ElementTree.parse(file).getroot() for proxy in group]


def visible(prop):
    """Whether a property stands in the panel."""
    return prop.get("panel_visibility") != "never" and prop.get("information_only") != "1" and prop.tag != "InputProperty"


class TestPanels(unittest.TestCase):
    def test_every_property_has_a_sentence(self):
        self.assertGreaterEqual(len(PROXIES), 13)
        for file, _, proxy in PROXIES:
            for prop in proxy:
                if prop.tag.endswith("Property"):
                    text = (prop.findtext("Documentation") or "").strip()
                    self.assertRegex(text, r"^[A-Z(].{4,}[.]$", f"{file}: {proxy.get('name')}.{prop.get('name')}")

    def test_every_property_is_in_a_labelled_group(self):
        for file, group, proxy in PROXIES:
            if group == "rimflow_internal":
                continue
            groups = list(proxy.iter("PropertyGroup"))
            grouped = [p.get("name") for g in groups for p in g.iter("Property")]
            self.assertEqual(len(grouped), len(set(grouped)), f"{file}: a property is in two groups")
            for g in groups:
                self.assertTrue(g.get("label"), file)
            for prop in proxy:
                if prop.tag.endswith("Property") and visible(prop):
                    self.assertIn(prop.get("name"), grouped, file)

    def test_help_and_menu(self):
        for file, group, proxy in PROXIES:
            text = proxy.find("Documentation")
            self.assertTrue(text.text.strip() or text.get("long_help"), file)
            if group == "rimflow_internal":
                continue
            self.assertRegex(text.get("short_help"), r"^[A-Z].{10,90}[.]$", file)
            self.assertGreater(len(text.get("long_help")), 60, file)
            hints = proxy.find("Hints")
            menu = hints.find("ShowInMenu")
            if menu is None:
                self.assertTrue(hints.find("ReaderFactory") is not None or hints.find("WriterFactory") is not None, file)
            else:
                self.assertEqual(menu.get("category"), "RIMFlow")
                self.assertRegex(menu.get("icon"), r"^:/pqWidgets/Icons/pq\w+[.]svg$", file)

    def test_labels_are_the_names_in_words(self):
        exceptions = {"SelectVelocity", "SelectAcceleration", "SelectPressure", "SelectPressureGradient", "SelectTrackId", "SelectInputVectors", "DiameterSigma"}
        for file, _, proxy in PROXIES:
            for prop in proxy:
                if prop.tag.endswith("Property") and prop.get("label") and prop.get("name") not in exceptions:
                    self.assertEqual(prop.get("label").replace(" ", ""), prop.get("name"), file)

    def test_outputs_have_names(self):
        for file, _, proxy in PROXIES:
            names = [port.get("name") for port in proxy.iter("OutputPort")]
            self.assertEqual(len(names), len(set(names)), file)
            self.assertTrue(all(names), file)


if __name__ == "__main__":
    unittest.main(verbosity=2)
