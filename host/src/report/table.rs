//! Tables: headings and rows of text and numbers.

use maud::{Markup, html};

/// What stands in one place of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// Words.
    Text(String),
    /// A number, rounded for people; the page keeps all its digits beside the text.
    Number {
        /// The number itself.
        value: f64,
        /// As it is shown.
        text: String,
    },
    /// A number that there is not.
    Missing,
    /// A number from −1 to 1 on a ground whose colour says how large it is.
    Share(f64),
    /// A hexadecimal digest or another long word that may be broken anywhere.
    Digest(String),
}

impl Cell {
    /// A number with so many digits after the point.
    pub fn fixed(value: f64, digits: usize) -> Self {
        Self::Number { value, text: format!("{value:.digits$}") }
    }

    /// A number with three significant digits and an exponent.
    pub fn scientific(value: f64) -> Self {
        Self::Number { value, text: format!("{value:.2e}") }
    }

    /// A number with six significant digits, as a model's parameters are shown.
    pub fn significant(value: f64) -> Self {
        let magnitude = if value == 0.0 { 0.0 } else { value.abs().log10().floor() };
        let digits = (5.0 - magnitude).clamp(0.0, 12.0) as usize;
        Self::fixed(value, digits)
    }

    /// A whole number.
    pub fn count(value: usize) -> Self {
        Self::Number { value: value as f64, text: value.to_string() }
    }

    /// The number that there may be; a dash where there is none.
    pub fn optional(value: Option<f64>, shown: impl Fn(f64) -> Self) -> Self {
        value.map_or(Self::Missing, shown)
    }

    /// As people read it.
    pub(super) fn text(&self) -> String {
        match self {
            Self::Text(text) | Self::Number { text, .. } | Self::Digest(text) => text.clone(),
            Self::Missing => "–".into(),
            // Adding zero takes the sign from what rounds to it.
            Self::Share(value) => format!("{:.2}", (100.0 * value).round() / 100.0 + 0.0),
        }
    }

    fn markup(&self, heading: bool) -> Markup {
        match self {
            Self::Text(text) if heading => html! { th scope="row" { (text) } },
            Self::Text(text) => html! { td { (text) } },
            Self::Number { value, text } => html! { td.number { data value=(value) { (text) } } },
            Self::Missing => html! { td.number { (self.text()) } },
            Self::Share(value) => {
                // Tenths: style sheets know no arithmetic on the text of an element.
                let tenths = (10.0 * value.abs()).round().clamp(0.0, 10.0);
                let class =
                    format!("number share {} tenths{tenths}", if *value < 0.0 { "negative" } else { "positive" });
                html! { td class=(class) { data value=(value) { (self.text()) } } }
            }
            Self::Digest(text) => html! { td.digest { (text) } },
        }
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.into())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

/// A table; the first column names the rows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// What the columns hold.
    pub headings: Vec<String>,
    /// The rows, each as long as the headings.
    pub rows: Vec<Vec<Cell>>,
}

impl Table {
    /// A table without rows.
    pub fn new<'a>(headings: impl IntoIterator<Item = &'a str>) -> Self {
        Self { headings: headings.into_iter().map(str::to_string).collect(), rows: Vec::new() }
    }

    /// This with one row more.
    pub fn row(mut self, cells: impl IntoIterator<Item = Cell>) -> Self {
        self.rows.push(cells.into_iter().collect());
        self
    }

    /// Whether a column holds numbers: it is headed on the side that they stand on.
    pub(super) fn is_of_numbers(&self, column: usize) -> bool {
        let of = |row: &Vec<Cell>| matches!(row.get(column), Some(Cell::Number { .. } | Cell::Share(_)));
        self.rows.iter().any(of)
    }

    pub(super) fn markup(&self) -> Markup {
        html! {
            // Wider than the page it scrolls by itself; reachable by keyboard.
            div.scroll tabindex="0" {
                table {
                    thead { tr {
                        @for (column, heading) in self.headings.iter().enumerate() {
                            th scope="col" class=[self.is_of_numbers(column).then_some("number")] { (heading) }
                        }
                    } }
                    tbody {
                        @for row in &self.rows {
                            tr { @for (column, cell) in row.iter().enumerate() { (cell.markup(column == 0)) } }
                        }
                    }
                }
            }
        }
    }
}
