//! The page: a title, what came out in one line, and sections.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::draw::{self, PictureError};
use super::picture::Picture;
use super::table::Table;

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

    /// A word for links to this section.
    fn anchor(&self) -> String {
        let word = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' };
        self.title.chars().map(word).collect()
    }

    fn markup(&self) -> Result<Markup, PictureError> {
        let blocks = self.blocks.iter().map(Block::markup).collect::<Result<Vec<Markup>, _>>()?;
        Ok(html! {
            section id=(self.anchor()) { h2 { (self.title) } @for block in blocks { (block) } }
        })
    }
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
                ul.legend { @for (name, ink) in &legend { li { span class=(format!("key {}", ink.class())) {} (name) } } }
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
        let sections = self.sections.iter().map(Section::markup).collect::<Result<Vec<Markup>, _>>()?;
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
                        ul { @for section in &self.sections {
                            li { a href={ "#" (section.anchor()) } { (section.title) } }
                        } }
                    }
                    main { @for section in sections { (section) } }
                }
            }
        };
        Ok(page.into_string())
    }
}
