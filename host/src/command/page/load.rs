//! The page of `load`.

use armid::load::Told;
use armid::recording::Recording;
use armid::report::{self, Assumed, Cell, Page, Picture, Section, Table};
use armid::robot::Robot;

use super::super::load::sentence;

/// What a movement with a load told.
pub struct Carried<'a> {
    pub robot: &'a Robot,
    /// Told in s after the movement's first row.
    pub told: &'a [Told],
    pub maximum_kg: f64,
    /// What was really carried, where that is known: times and masses.
    pub carried: Option<Vec<(f64, f64)>>,
    /// The movements, and what they are called.
    pub runs: &'a [(&'a Recording, &'a str)],
    /// Their tracking errors.
    pub errors: Vec<Picture>,
}

impl Carried<'_> {
    /// Mass over time with its band, the tracking errors below it, and what was told.
    pub fn sections(&self) -> Vec<Section> {
        let robot = self.robot;
        let course = Assumed::course(self.maximum_kg, self.told);
        let samples = self.runs.iter().map(|(recording, _)| recording.samples()).max().unwrap_or(0);
        let duration_s = samples as f64 * robot.record_period_s;
        let mut pictures = vec![report::assumed_load(&course, duration_s, self.carried.clone())];
        pictures.extend(self.errors.iter().cloned());
        let mut table = Table::new(["from, s", "assumed, kg", "± standard error, kg"]);
        for one in &course {
            table = table.row([
                Cell::fixed(one.from_s, 3),
                Cell::fixed(one.mass_kg, 3),
                Cell::optional(one.standard_error_kg, |error| Cell::fixed(error, 3)),
            ]);
        }
        let mut events = Table::new(["time, s", "told"]);
        for told in self.told {
            events = events.row([Cell::fixed(told.at_s, 3), Cell::from(sentence(robot, &told.news))]);
        }
        vec![
            Section::new("Load over time").table(table).pictures(pictures),
            Section::new("Tracking").table(report::quality(robot, self.runs)),
            Section::new("What was told").table(events),
        ]
    }

    /// The page with the section of what was `found` first; none where no load is active.
    pub fn page(&self, verdict: String, found: Option<Section>, rest: Vec<Section>) -> Page {
        let mut sections = Vec::from_iter(found);
        sections.extend(self.sections());
        sections.extend(rest);
        Page { command: "load".into(), title: self.robot.name.clone(), verdict, sections }
    }
}

/// Times of what was told, from the first row on: the first row is too early to tell of motion, so that is told with it.
pub fn from_first_row(told: &[Told]) -> Vec<Told> {
    let start_s = told.first().map_or(0.0, |told| told.at_s);
    told.iter().map(|told| Told { at_s: told.at_s - start_s, ..*told }).collect()
}
