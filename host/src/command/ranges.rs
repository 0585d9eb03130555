//! `armid ranges`.

use std::fmt::Write as _;
use std::path::PathBuf;

use armid::links::{ArmBounds, Nearest, Violation, nearest};
use clap::Args;
use nalgebra::DMatrix;
use serde_json::{Value, json};
use shared::arm::PARAMETERS;

use super::CommandError;
use super::common::{RobotArguments, print, print_json, read_model};

const EXAMPLES: &str = "Examples:
  armid ranges bounds.toml                          search ranges for the robot file
  armid ranges bounds.toml --check model.toml";

/// Arguments of `ranges`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Ranges {
    /// Bounds on masses, centres and inertias: upper_arm_m, and for each link a table called like its joint, [link_2] and
    /// [link_3] for joints 2 and 3, with mass_kg, centre_x_m, centre_y_m, inertia_kg_m2 (about the centre of mass) and
    /// motor_inertia_kg_m2, each [LEAST, GREATEST]
    #[arg(value_name = "BOUNDS")]
    bounds: PathBuf,
    #[command(flatten)]
    robot: RobotArguments,
    /// Tell whether any links within the bounds give the f of this model
    #[arg(long, value_name = "MODEL")]
    check: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Ranges {
    pub fn run(&self) -> Result<(), CommandError> {
        let robot = self.robot.read()?;
        let bounds = ArmBounds::read(&self.bounds, &robot)?;
        let Some(path) = &self.check else {
            let ranges = bounds.ranges();
            return if self.json { print_json(&json!({"search": table(&ranges)})) } else { print(text(&ranges)) };
        };
        let model = read_model(path, &robot)?;
        let verdict = Verdict::of(&bounds, &model.f, &armid::links::information(&model));
        if self.json { print_json(&verdict.to_json()) } else { print(verdict.text()) }
    }
}

fn table(ranges: &[[f64; 2]; PARAMETERS]) -> serde_json::Map<String, Value> {
    ranges.iter().enumerate().map(|(index, range)| (format!("f{}", index + 1), json!(range))).collect()
}

/// The `[search]` table of a robot file.
fn text(ranges: &[[f64; 2]; PARAMETERS]) -> String {
    let mut text = String::from("[search]");
    for (index, [low, high]) in ranges.iter().enumerate() {
        // Writing to a String cannot fail.
        let _ = write!(text, "\nf{} = [{low:.4}, {high:.4}]", index + 1);
    }
    text
}

/// Whether links within bounds give an f.
pub struct Verdict {
    f: [f64; PARAMETERS],
    upper_arm_m: f64,
    /// How far f3 and f4 are from a3 f5 and a3 f6.
    untied: [f64; 2],
    /// Bounds that every set of links that gives f breaks.
    pub violations: Vec<Violation>,
    /// The nearest f that links within bounds give.
    pub nearest: Option<Nearest>,
}

impl Verdict {
    /// Judges `f`, whose covariance is the inverse of `information`.
    pub fn of(bounds: &ArmBounds, f: &[f64; PARAMETERS], information: &DMatrix<f64>) -> Self {
        let (_, violations) = bounds.links_of(f);
        let a3 = bounds.upper_arm_m;
        Self {
            f: *f,
            upper_arm_m: a3,
            untied: [f[2] - a3 * f[4], f[3] - a3 * f[5]],
            violations,
            nearest: nearest(bounds, f, information),
        }
    }

    /// The verdict in words.
    pub fn text(&self) -> String {
        let mut lines = Vec::new();
        if self.violations.is_empty() {
            lines.push("links within the bounds give f1, f2 and f5 to f9".to_string());
        } else {
            lines.push("no links within the bounds give this f; those that come nearest break:".to_string());
            lines.extend(self.violations.iter().map(|violation| format!("  {violation}")));
        }
        lines.push(format!(
            "ties of an upper arm of {} m: f3 − a3 f5 = {:.5}, f4 − a3 f6 = {:.5}",
            self.upper_arm_m, self.untied[0], self.untied[1]
        ));
        match &self.nearest {
            Some(nearest) => {
                lines.push(format!(
                    "nearest f that links within the bounds give, {:.2} standard errors away:",
                    nearest.distance
                ));
                for (index, (value, given)) in nearest.f.iter().zip(self.f).enumerate() {
                    lines.push(format!("  f{} = {value:.6} ({:+.6})", index + 1, value - given));
                }
            }
            None => lines.push("the bounds contradict each other: no links keep to all of them".into()),
        }
        lines.join("\n")
    }

    /// The verdict for machines.
    pub fn to_json(&self) -> Value {
        json!({
            "feasible": self.violations.is_empty(),
            "violations": self.violations,
            "ties": {"f3_minus_a3_f5": self.untied[0], "f4_minus_a3_f6": self.untied[1]},
            "nearest_f": self.nearest.map(|nearest| nearest.f),
            "distance_standard_errors": self.nearest.map(|nearest| nearest.distance),
        })
    }
}
