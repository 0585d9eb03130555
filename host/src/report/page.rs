//! The page: a title, what came out in one line, and sections.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::draw::{self, PictureError};
use super::picture::Picture;
use super::table::Table;
use crate::shown;

/// The style sheet: themes, pictures that follow them, phones, paper.
const STYLE: &str = include_str!("style.css");

/// Nothing is fetched and nothing runs, whatever a name in the data tries.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'";

/// A piece of a section.
#[derive(Clone, Debug)]
pub enum Block {
    /// A paragraph.
    Text(String),
    /// Sentences.
    List(Vec<String>),
    /// A table.
    Table(Table),
    /// Pictures, side by side where there is room.
    Pictures(Vec<Picture>),
}

/// A part of a page under a heading.
#[derive(Clone, Debug)]
pub struct Section {
    /// The heading.
    pub title: String,
    /// What stands under it.
    pub blocks: Vec<Block>,
}

impl Section {
    /// A section without content.
    pub fn new(title: impl Into<String>) -> Self {
        Self { title: title.into(), blocks: Vec::new() }
    }

    /// This with one paragraph more.
    pub fn text(mut self, text: impl Into<String>) -> Self {
        self.blocks.push(Block::Text(text.into()));
        self
    }

    /// This with a list more, if there is anything to list.
    pub fn list(mut self, sentences: impl IntoIterator<Item = String>) -> Self {
        let sentences: Vec<String> = sentences.into_iter().collect();
        if !sentences.is_empty() {
            self.blocks.push(Block::List(sentences));
        }
        self
    }

    /// This with one table more.
    pub fn table(mut self, table: Table) -> Self {
        self.blocks.push(Block::Table(table));
        self
    }

    /// This with pictures more, if there are any.
    pub fn pictures(mut self, pictures: Vec<Picture>) -> Self {
        if !pictures.is_empty() {
            self.blocks.push(Block::Pictures(pictures));
        }
        self
    }

    fn markup(&self, anchor: &str) -> Result<Markup, PictureError> {
        let blocks = self.blocks.iter().map(Block::markup).collect::<Result<Vec<Markup>, _>>()?;
        Ok(html! {
            section id=(anchor) { h2 { (self.title) } @for block in blocks { (block) } }
        })
    }
}

/// The name of the section at a place, for links to it.
fn anchor(place: usize) -> String {
    format!("section-{}", place + 1)
}

impl Block {
    fn markup(&self) -> Result<Markup, PictureError> {
        Ok(match self {
            Self::Text(text) => html! { p { (text) } },
            Self::List(sentences) => html! { ul { @for sentence in sentences { li { (sentence) } } } },
            Self::Table(table) => table.markup(),
            Self::Pictures(pictures) => {
                let figures = pictures.iter().map(figure).collect::<Result<Vec<Markup>, _>>()?;
                html! { div.pictures { @for figure in figures { (figure) } } }
            }
        })
    }
}

/// A picture with its title and its legend, which are text of the page: they wrap where it is narrow.
fn figure(picture: &Picture) -> Result<Markup, PictureError> {
    let svg = draw::inline(picture)?;
    let legend = picture.legend();
    Ok(html! {
        figure {
            figcaption { (picture.title) }
            div.picture role="img" aria-label=(picture.title) { (PreEscaped(svg)) }
            @if !legend.is_empty() {
                ul.legend { @for key in &legend { li { span class=(key.class()) {} (key.name) } } }
            }
            @if let Some(note) = &picture.note { p.note { (note) } }
        }
    })
}

/// A report.
#[derive(Clone, Debug)]
pub struct Page {
    /// The command that made it, such as `identify`.
    pub command: String,
    /// What it is about: the robot, mostly.
    pub title: String,
    /// What came out, in a sentence or two.
    pub verdict: String,
    /// Its parts.
    pub sections: Vec<Section>,
}

impl Page {
    /// The page as HTML: one file, nothing beside it.
    pub fn to_html(&self) -> Result<String, PictureError> {
        let placed = self.sections.iter().enumerate();
        let sections =
            placed.map(|(place, section)| section.markup(&anchor(place))).collect::<Result<Vec<Markup>, _>>()?;
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta http-equiv="Content-Security-Policy" content=(POLICY);
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta name="color-scheme" content="light dark";
                    title { "armid " (self.command) ": " (self.title) }
                    style { (PreEscaped(STYLE)) }
                }
                body {
                    header {
                        p.command { "armid " (self.command) }
                        h1 { (self.title) }
                        p.verdict { (self.verdict) }
                    }
                    nav aria-label="Sections" {
                        ul { @for (place, section) in self.sections.iter().enumerate() {
                            li { a href={ "#" (anchor(place)) } { (section.title) } }
                        } }
                    }
                    main { @for section in sections { (section) } }
                }
            }
        };
        Ok(shown::lines(&page.into_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::{Cell, Content, Ink, Interval, Intervals, Line, Map, Section};

    const HOSTILE: &str = "</title></style><script>alert(1)</script>&\"'";

    /// A page with `name` wherever a name can be.
    fn page(name: &str) -> Page {
        let lines = vec![Line::new(name, Ink::Measured, vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, -1.0)])];
        let interval = Some(Interval { low: 0.1, value: 1.0, high: 10.0 });
        let intervals = Intervals {
            names: vec![name.into(), name.into()],
            sources: vec![(name.into(), Ink::Nth(1), vec![interval, None])],
            logarithmic: true,
        };
        let map = Map { x: [0.0, 1.0], y: [0.0, 1.0], cells: vec![vec![Some(1.0), None], vec![Some(-0.5), None]] };
        let pictures = vec![
            Picture::lines(name, [name, name], lines).note(name),
            Picture::of(name, [name, name], Content::Intervals(intervals)),
            Picture::of(name, [name, name], Content::Map(map)),
        ];
        let table =
            Table::new([name, name]).row([Cell::from(name), Cell::Share(-0.8)]).row([Cell::from(name), Cell::Missing]);
        let section = Section::new(name).text(name).list([name.to_string()]).table(table).pictures(pictures);
        Page { command: name.into(), title: name.into(), verdict: name.into(), sections: vec![section] }
    }

    /// Names change the text of a page and its labels, never its elements.
    #[test]
    fn names_are_text_wherever_they_stand() {
        let elements = |name: &str| {
            let html = page(name).to_html().unwrap();
            let body = &html[html.find("<body").unwrap()..html.find("</html>").unwrap()];
            let document = roxmltree::Document::parse(body).unwrap();
            let elements = document.descendants().filter(|node| node.is_element());
            let text: String =
                document.descendants().filter_map(|node| node.text().filter(|_| node.is_text())).collect();
            (elements.map(|element| element.tag_name().name().to_string()).collect::<Vec<String>>(), text)
        };
        let (plain, hostile) = (elements("plain"), elements(HOSTILE));
        assert_eq!(plain.0, hostile.0);
        assert_eq!(plain.1.matches("plain").count(), hostile.1.matches(HOSTILE).count());
        assert!(plain.0.iter().filter(|tag| *tag == "svg").count() == 3 && !plain.0.contains(&"script".to_string()));
        let head = page(HOSTILE).to_html().unwrap();
        assert_eq!(head.matches("</title>").count(), 1);
        assert_eq!(head.matches("</style>").count(), 1);
    }

    /// A line with a gap of no numbers, bounds without a logarithm and empty pictures are drawn as far as they can be.
    #[test]
    fn pictures_hold_finite_coordinates_alone() {
        let nothing = Picture::lines("nothing", ["x", "y"], vec![Line::new("", Ink::Left, vec![(f64::NAN, 1.0)])]);
        let html = draw::inline(&nothing).unwrap() + &page("plain").to_html().unwrap();
        assert!(!html.contains("NaN") && !html.contains("inf"), "{html}");
    }

    /// Every colour that a picture is drawn in is one that the style sheet gives for light and dark.
    #[test]
    fn the_style_sheet_knows_every_colour_of_a_picture() {
        let html = page("plain").to_html().unwrap();
        for attribute in ["fill=\"#", "stroke=\"#"] {
            for part in html.split("<svg").skip(1).flat_map(|svg| svg.split(attribute).skip(1)) {
                let colour = format!("{attribute}{}\"", &part[..6]);
                assert!(STYLE.contains(&colour), "{colour} is not in the style sheet");
            }
        }
    }
}
