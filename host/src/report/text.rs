//! Sections as plain text, for a terminal: the sentences and tables of a page without its pictures.

use super::page::{Block, Section};
use super::table::Table;

/// Between two columns.
const GAP: &str = "  ";

impl Section {
    /// The heading with sentences and tables under it.
    pub fn to_text(&self) -> String {
        let block = |block: &Block| match block {
            Block::Text(text) => Some(text.clone()),
            Block::List(sentences) => Some(sentences.join("\n")),
            Block::Table(table) => Some(table.to_text()),
            Block::Pictures(_) => None,
        };
        std::iter::once(self.title.clone()).chain(self.blocks.iter().filter_map(block)).collect::<Vec<_>>().join("\n")
    }
}

impl Table {
    /// Aligned columns, as narrow as their cells and the longest words of their headings.
    fn to_text(&self) -> String {
        let cells: Vec<Vec<String>> =
            self.rows.iter().map(|row| row.iter().map(|cell| cell.text()).collect()).collect();
        let width = |column: usize| {
            let of_cells = cells.iter().filter_map(|row| row.get(column)).map(|text| text.chars().count());
            let of_words = self.headings[column].split(' ').map(|word| word.chars().count());
            of_cells.chain(of_words).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..self.headings.len()).map(width).collect();
        let headings: Vec<Vec<String>> =
            self.headings.iter().zip(&widths).map(|(heading, &width)| wrapped(heading, width)).collect();
        let height = headings.iter().map(Vec::len).max().unwrap_or(0);
        // A heading stands on its column.
        let head = (0..height).map(|line| {
            let of = |lines: &Vec<String>| (line + lines.len()).checked_sub(height).map_or("", |at| &lines[at]).into();
            headings.iter().map(of).collect::<Vec<String>>()
        });
        let line = |row: Vec<String>| {
            let placed = row.into_iter().zip(&widths).enumerate().map(|(column, (text, &width))| {
                if self.is_of_numbers(column) { format!("{text:>width$}") } else { format!("{text:<width$}") }
            });
            placed.collect::<Vec<_>>().join(GAP).trim_end().to_owned()
        };
        head.chain(cells.iter().cloned()).map(line).collect::<Vec<_>>().join("\n")
    }
}

/// Lines of whole words, none wider than `width`.
fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = vec![String::new()];
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use crate::report::{Cell, Picture, Section, Table};

    #[test]
    fn tables_stand_in_columns_and_pictures_are_left_to_the_page() {
        let table = Table::new(["", "mass found, kg", "remark"])
            .row([Cell::from("first"), Cell::fixed(0.5, 2), Cell::from("ok")])
            .row([Cell::from("2nd"), Cell::fixed(-12.25, 2), Cell::Missing]);
        let picture = Picture::lines("a picture", ["x", "y"], Vec::new());
        let section = Section::new("Masses").text("As weighed.").table(table).pictures(vec![picture]);
        let expected = "\
Masses
As weighed.
         mass
       found,
           kg  remark
first    0.50  ok
2nd    -12.25  –";
        assert_eq!(section.to_text(), expected);
    }
}
