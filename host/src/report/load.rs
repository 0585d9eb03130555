//! A load in the gripper: what computed torque assumes, over time.

use shared::load::LoadNews;

use super::picture::{Band, Content, Ink, Line, Picture};
use crate::load::Told;

/// What computed torque assumes from a time on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Assumed {
    /// From when, s after the first row.
    pub from_s: f64,
    /// The mass, kg.
    pub mass_kg: f64,
    /// Its standard error where it was identified, kg.
    pub standard_error_kg: Option<f64>,
}

impl Assumed {
    /// What was assumed from the start, half of `maximum_kg`, and after everything told.
    pub fn course(maximum_kg: f64, told: &[Told]) -> Vec<Self> {
        let mut course = vec![Self { from_s: 0.0, mass_kg: 0.5 * maximum_kg, standard_error_kg: None }];
        for told in told {
            let (mass_kg, standard_error_kg) = match told.news {
                LoadNews::Found(found) => (f64::from(found.mass_kg), Some(f64::from(found.standard_error_kg))),
                LoadNews::Changed { assumed_kg, .. } => (f64::from(assumed_kg), None),
                _ => continue,
            };
            course.push(Self { from_s: told.at_s, mass_kg, standard_error_kg });
        }
        course
    }
}

/// The mass assumed over a movement with its 95 % band, and the mass carried where that is known: times and masses.
pub fn assumed_load(course: &[Assumed], duration_s: f64, carried: Option<Vec<(f64, f64)>>) -> Picture {
    let until = |index: usize| course.get(index + 1).map_or(duration_s, |next| next.from_s);
    let points = course.iter().enumerate();
    let assumed = points.flat_map(|(index, one)| [(one.from_s, one.mass_kg), (until(index), one.mass_kg)]).collect();
    let bands = course.iter().enumerate().filter_map(|(index, one)| {
        let half = 1.96 * one.standard_error_kg?;
        let at = |time_s: f64| [time_s, one.mass_kg - half, one.mass_kg + half];
        let points = vec![at(one.from_s), at(until(index))];
        Some(Band { name: "95 % interval".into(), ink: Ink::Measured, points })
    });
    let mut lines: Vec<Line> = carried.map(|points| Line::new("carried", Ink::Simulated, points)).into_iter().collect();
    lines.push(Line::new("assumed by computed torque", Ink::Measured, assumed));
    Picture::of("Mass in the gripper", ["time, s", "kg"], Content::Lines(bands.collect(), lines))
}
