//! How a search went, and how certain its result is.

use super::page::Section;
use super::picture::{Content, Ink, Line, Picture};
use super::table::{Cell, Table};
use crate::identify::Identification;
use crate::robot::Robot;

/// The course of the search: the best of each subpopulation where there are several, and the best of all.
pub fn convergence(found: &Identification) -> Option<Section> {
    let (first, last) = (found.generations.first()?, found.generations.last()?);
    let subpopulations = first.subpopulation_counts2.len();
    let at = |generation: usize| generation as f64;
    let mut lines: Vec<Line> = (0..subpopulations)
        .map(|index| {
            let best = found.generations.iter().enumerate();
            let points = best.map(|(k, generation)| (at(k), generation.subpopulation_counts2[index])).collect();
            Line::new(format!("subpopulation {}", index + 1), Ink::Nth(index), points)
        })
        .collect();
    if subpopulations == 0 {
        let best = found.generations.iter().enumerate();
        lines.push(Line::new("best", Ink::Measured, best.map(|(k, one)| (at(k), one.best_counts2)).collect()));
    }
    let picture = Picture::of("Least Y so far", ["generation", "Y, counts²"], Content::LogarithmicLines(lines));
    let mut table = Table::new(["", "generation", "candidates", "least Y, counts²"]);
    for (name, index, generation) in [("first", 0, first), ("last", found.generations.len() - 1, last)] {
        table = table.row([
            Cell::from(name),
            Cell::count(index),
            Cell::count(generation.evaluations),
            Cell::fixed(generation.best_counts2, 1),
        ]);
    }
    let around = "The search began around the fitted result. What it came upon shows by how much luck with the ringing of the \
                  loop can lower Y; it is not taken.";
    Some(
        Section::new("Search")
            .text(
                "Y is the paper's objective: the sum of squared differences between the recorded and the simulated tracking \
                 errors, both joints.",
            )
            .list((subpopulations == 0).then(|| around.to_string()))
            .table(table)
            .pictures(vec![picture]),
    )
}

/// Correlations, condition number, and what the recordings leave open.
pub fn certainty(robot: &Robot, found: &Identification) -> Option<Section> {
    let correlations = found.correlations.as_ref()?;
    let names: Vec<String> = found.free.iter().map(|parameter| parameter.name(robot)).collect();
    let mut table = Table::new(std::iter::once("").chain(names.iter().map(String::as_str)));
    for (name, row) in names.iter().zip(correlations) {
        let cells = row.iter().map(|&value| if value.is_finite() { Cell::Share(value) } else { Cell::from("–") });
        table = table.row(std::iter::once(Cell::from(name.as_str())).chain(cells));
    }
    let mut section = Section::new("Correlations");
    if let Some(number) = found.condition_number {
        section = section.text(format!(
            "Condition number of the information matrix, scaled to a unit diagonal: {number:.3e}. It is 1 where every \
             parameter shows by itself."
        ));
    }
    Some(section.list(found.weak_directions.iter().map(|direction| direction.sentence(robot))).table(table))
}
