//! What `armid load` found, for a reader, for a program and for the page.

use armid::capture::tracking_quality;
use armid::load::Told;
use armid::recording::Recording;
use armid::report::{Cell, Section, Table};
use armid::robot::Robot;
use serde_json::{Value, json};
use shared::load::{LoadEstimate, LoadNews, LoadSettings};

use super::Place;
use super::words::{self, active, sentence, with_error};

/// What was found, to be told.
pub struct Outcome {
    found: LoadEstimate,
    place: Place,
    collect_s: f64,
    identify_s: f64,
    settings: LoadSettings,
    /// How often the load has changed.
    changes: usize,
}

/// What the rows say of centre or inertia.
#[derive(Clone, Copy, PartialEq)]
enum Source {
    /// Nothing was asked of them.
    TakenAsKnown,
    /// They halved the standard error that was given.
    Rows,
    /// They did not.
    Given,
}

/// Centre or inertia.
struct Quantity {
    name: &'static str,
    unit: &'static str,
    value: f32,
    error: f32,
    given: f32,
    given_error: f32,
}

impl Quantity {
    fn source(&self) -> Source {
        match self.given_error {
            0.0 => Source::TakenAsKnown,
            given_error if self.error < 0.5 * given_error => Source::Rows,
            _ => Source::Given,
        }
    }
}

impl Outcome {
    /// Of an estimate from rows of so many seconds, found within so many more.
    pub fn new(
        found: &LoadEstimate,
        place: Place,
        [collect_s, identify_s]: [f64; 2],
        settings: &LoadSettings,
        told: &[Told],
    ) -> Self {
        let mut found = *found;
        // The search lets what is known move by a hundredth of a per cent, which is its way of holding it.
        if settings.centre_standard_error_m == 0.0 {
            found.centre_m = settings.centre_m;
            found.centre_standard_error_m = [0.0; 2];
        }
        if settings.inertia_standard_error_kg_m2 == 0.0 {
            found.inertia_kg_m2 = settings.inertia_kg_m2;
            found.inertia_standard_error_kg_m2 = 0.0;
        }
        let changes = told.iter().filter(|told| matches!(told.news, LoadNews::Changed { .. })).count();
        Self { found, place, collect_s, identify_s, settings: *settings, changes }
    }

    /// The estimate; what was taken as known is as it was given.
    pub fn found(&self) -> &LoadEstimate {
        &self.found
    }

    fn place_name(&self) -> &'static str {
        match self.place {
            Place::Board => "board",
            Place::Host => "host",
        }
    }

    fn quantities(&self) -> [Quantity; 3] {
        let (found, settings) = (&self.found, &self.settings);
        let centre = |name, axis: usize| Quantity {
            name,
            unit: "m",
            value: found.centre_m[axis],
            error: found.centre_standard_error_m[axis],
            given: settings.centre_m[axis],
            given_error: settings.centre_standard_error_m,
        };
        let inertia = Quantity {
            name: "inertia",
            unit: "kg m²",
            value: found.inertia_kg_m2,
            error: found.inertia_standard_error_kg_m2,
            given: settings.inertia_kg_m2,
            given_error: settings.inertia_standard_error_kg_m2,
        };
        [centre("centre x", 0), centre("centre y", 1), inertia]
    }

    /// What makes the result doubtful, with what to do.
    pub fn doubts(&self) -> Vec<String> {
        words::doubts(&self.found, &self.settings, self.changes)
    }

    /// For a program.
    pub fn to_json(&self, robot: &Robot, told: &[Told], recording: &Recording) -> Value {
        let found = &self.found;
        let quantities = self.quantities();
        let from_data: Vec<&str> =
            quantities.iter().filter(|one| one.source() == Source::Rows).map(|one| one.name).collect();
        let list: Vec<Value> =
            told.iter().map(|told| json!({"at_s": told.at_s, "news": sentence(robot, &told.news)})).collect();
        json!({
            "mass_kg": found.mass_kg,
            "standard_error_kg": found.standard_error_kg,
            "where": self.place_name(),
            "collect_s": self.collect_s,
            "identify_s": self.identify_s,
            "active": true,
            "centre_m": found.centre_m,
            "centre_standard_error_m": found.centre_standard_error_m,
            "inertia_kg_m2": found.inertia_kg_m2,
            "inertia_standard_error_kg_m2": found.inertia_standard_error_kg_m2,
            "found_in_data": from_data,
            "noise_ratio": found.noise_ratio,
            "max_abs_error_counts":
                tracking_quality(recording).iter().map(|joint| joint.max_abs_error_counts).collect::<Vec<_>>(),
            "doubts": self.doubts(),
            "events": list,
        })
    }

    /// For the page.
    pub fn section(&self) -> Section {
        let found = &self.found;
        let mut table = Table::new(["", "value", "± standard error", "unit", "told by the rows"]);
        let mass = ("mass", [found.mass_kg, found.standard_error_kg], "kg", "yes".into());
        let others = self.quantities().map(|one| {
            let told = match one.source() {
                Source::TakenAsKnown => "no: taken as known".into(),
                Source::Rows => "yes".into(),
                Source::Given => format!("hardly more than was given: {} ± {}", one.given, one.given_error),
            };
            (one.name, [one.value, one.error], one.unit, told)
        });
        for (name, [value, error], unit, told) in std::iter::once(mass).chain(others) {
            table = table.row([
                Cell::from(name),
                Cell::significant(value.into()),
                Cell::scientific(error.into()),
                Cell::from(unit),
                Cell::from(told),
            ]);
        }
        Section::new("Load")
            .table(table)
            .text(format!(
                "Found on the {} from {:.2} s of rows; what the model leaves of the rows is {:.2} of the encoder's noise.",
                self.place_name(),
                self.collect_s,
                found.noise_ratio
            ))
            .list(self.doubts())
    }

    /// For a reader.
    pub fn text(&self, recording: &Recording) -> String {
        let found = &self.found;
        let mut lines = vec![
            active(found),
            format!(
                "found on the {} from {:.2} s of rows, in use {:.3} s after the last of them; what the model leaves of the \
                 rows is {:.2} of the encoder's noise",
                self.place_name(),
                self.collect_s,
                self.identify_s,
                found.noise_ratio
            ),
        ];
        for one in self.quantities() {
            let Quantity { name, unit, value, error, given, given_error } = one;
            lines.push(match one.source() {
                Source::TakenAsKnown => format!("{name}: {given} {unit}, taken as known"),
                Source::Rows => format!("{name}: {} {unit}", with_error(value, error)),
                Source::Given => format!(
                    "{name}: {} {unit}; these rows tell hardly more than the {given} ± {given_error} {unit} given",
                    with_error(value, error)
                ),
            });
        }
        let largest: Vec<String> =
            tracking_quality(recording).iter().map(|joint| format!("{:.0}", joint.max_abs_error_counts)).collect();
        lines.push(format!("largest tracking error of the whole movement: {} counts", largest.join(" / ")));
        lines.join("\n")
    }
}
