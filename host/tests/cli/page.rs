//! A report page as a test sees it: parsed, checked to stand on its own, and read section by section.

use roxmltree::{Document, Node};

use crate::bench::Bench;

/// A page that was written.
pub struct Page(String);

impl Page {
    /// Reads the page and checks what holds for every one: it is well-formed, it fetches and runs nothing, its links lead
    /// to its own sections, and its pictures are drawn to numbers.
    pub fn read(bench: &Bench, name: &str) -> Self {
        let html = std::fs::read_to_string(bench.path(name)).unwrap();
        assert!(html.starts_with("<!DOCTYPE html><html lang=\"en\">"), "{name}");
        // As XML: without the declaration of HTML, and with its one kind of element that has no end closed.
        let body = html.strip_prefix("<!DOCTYPE html>").unwrap();
        let mut parts = body.split("<meta ");
        let mut xml = parts.next().unwrap().to_string();
        for part in parts {
            let (attributes, rest) = part.split_once('>').unwrap();
            xml.push_str(&format!("<meta {attributes}/>{rest}"));
        }
        let page = Self(xml);
        page.stands_on_its_own(name);
        page
    }

    fn parsed(&self) -> Document<'_> {
        Document::parse(&self.0).unwrap_or_else(|error| panic!("{error}: {}", self.0))
    }

    fn stands_on_its_own(&self, name: &str) {
        let document = self.parsed();
        let elements = || document.descendants().filter(Node::is_element);
        let known = [
            "html",
            "head",
            "meta",
            "title",
            "style",
            "body",
            "header",
            "nav",
            "main",
            "section",
            "h1",
            "h2",
            "p",
            "ul",
            "li",
            "a",
            "span",
            "div",
            "figure",
            "figcaption",
            "table",
            "thead",
            "tbody",
            "tr",
            "th",
            "td",
            "data",
            "svg",
            "line",
            "polyline",
            "polygon",
            "rect",
            "circle",
            "text",
        ];
        let ids: Vec<&str> = elements().filter_map(|element| element.attribute("id")).collect();
        for (place, id) in ids.iter().enumerate() {
            assert!(!ids[..place].contains(id), "{name}: two sections are {id}");
        }
        for element in elements() {
            let tag = element.tag_name().name();
            assert!(known.contains(&tag), "{name}: <{tag}>");
            for attribute in element.attributes() {
                let (key, value) = (attribute.name(), attribute.value());
                assert!(
                    !key.starts_with("on") && !["src", "srcset", "action", "style"].contains(&key),
                    "{name}: {key}"
                );
                if key == "href" {
                    let target = value.strip_prefix('#').unwrap_or_else(|| panic!("{name}: a link to {value}"));
                    assert!(ids.contains(&target), "{name}: no {target}");
                }
                if ["points", "x", "y", "x1", "y1", "x2", "y2", "cx", "cy", "r", "width", "height"].contains(&key) {
                    let numbers = value.split([' ', ',']).filter(|number| !number.is_empty());
                    for number in numbers {
                        assert!(number.parse::<f64>().is_ok_and(f64::is_finite), "{name}: {key} is {value}");
                    }
                }
            }
        }
        let style = elements().find(|element| element.has_tag_name("style")).unwrap().text().unwrap();
        assert!(style.contains("prefers-color-scheme: dark") && style.contains("@media print"), "{name}");
        assert!(["url(", "@import", "http"].iter().all(|part| !style.contains(part)), "{name}: {style}");
        let policy = elements().find(|element| element.attribute("http-equiv") == Some("Content-Security-Policy"));
        assert!(policy.unwrap().attribute("content").unwrap().contains("default-src 'none'"), "{name}");
        for svg in elements().filter(|element| element.has_tag_name(("http://www.w3.org/2000/svg", "svg"))) {
            let drawn = svg
                .descendants()
                .filter(|shape| ["polyline", "polygon", "circle", "rect"].contains(&shape.tag_name().name()));
            assert!(drawn.count() > 0, "{name}: an empty picture");
        }
    }

    /// The headings of its sections.
    pub fn sections(&self) -> Vec<String> {
        let document = self.parsed();
        let headings = document.descendants().filter(|element| element.has_tag_name("h2"));
        headings.map(|heading| heading.text().unwrap_or_default().to_string()).collect()
    }

    /// Makes sure that the sections are these, each with something under its heading.
    pub fn expect_sections(&self, expected: &[&str]) {
        assert_eq!(self.sections(), expected);
        let document = self.parsed();
        for section in document.descendants().filter(|element| element.has_tag_name("section")) {
            assert!(section.children().filter(Node::is_element).count() > 1, "an empty section of {expected:?}");
        }
    }

    /// The text of everything.
    pub fn text(&self) -> String {
        text(self.parsed().root())
    }

    /// The titles of a section's pictures.
    pub fn pictures(&self, section: &str) -> Vec<String> {
        self.of(section, |section| {
            section.descendants().filter(|element| element.has_tag_name("figcaption")).map(text).collect()
        })
    }

    /// What stands in the legends of a section.
    pub fn legends(&self, section: &str) -> Vec<String> {
        self.of(section, |section| {
            let legends = section.descendants().filter(|element| element.attribute("class") == Some("legend"));
            legends.flat_map(|legend| legend.children().filter(Node::is_element)).map(text).collect()
        })
    }

    /// The rows of a section's table, numbers with all their digits.
    pub fn table(&self, section: &str, which: usize) -> Vec<Vec<String>> {
        self.of(section, |section| {
            let table = section.descendants().filter(|element| element.has_tag_name("tbody")).nth(which);
            let table = table.unwrap_or_else(|| panic!("too few tables"));
            let cells = |row: Node| row.children().filter(Node::is_element).map(cell).collect();
            table.children().filter(Node::is_element).map(cells).collect()
        })
    }

    /// The numbers of one column of a section's table, counted from 0; rows without one are left out.
    pub fn column(&self, section: &str, which: usize, column: usize) -> Vec<f64> {
        self.table(section, which).iter().filter_map(|row| row[column].parse().ok()).collect()
    }

    fn of<T>(&self, section: &str, read: impl FnOnce(Node) -> T) -> T {
        let document = self.parsed();
        let heading = document
            .descendants()
            .find(|element| element.has_tag_name("h2") && element.text() == Some(section))
            .unwrap_or_else(|| panic!("no section {section:?} in {:?}", self.sections()));
        read(heading.parent().unwrap())
    }
}

fn text(node: Node) -> String {
    node.descendants().filter(Node::is_text).filter_map(|node| node.text()).collect()
}

fn cell(cell: Node) -> String {
    let number = cell.descendants().find_map(|element| element.attribute("value"));
    number.map_or_else(|| text(cell), str::to_string)
}
