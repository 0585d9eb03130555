//! A robot file from answers: questions one after the other, each answer checked as the robot file itself is.
//!
//! Masses, centres and inertias are asked as rough guesses: they give the search ranges, the arm to expect and, with them,
//! the gains that are proposed.

mod proposal;
mod questions;
mod text;

use std::collections::BTreeMap;
use std::path::Path;

use crate::board_setup::{SetupError, configuration};
use crate::file_error::FileError;
use crate::links::Link;
use crate::robot::{Kind, Law, Robot};
use crate::toml_text::TomlText;

use questions::{Put, Step, steps};

/// Robot files to begin with: name, what it is, text.
pub const EXAMPLES: [(&str, &str, &str); 3] = [
    ("puma-560", "links 2 and 3 of the PUMA 560, the robot without --robot", include_str!("../robots/puma-560.toml")),
    (
        "direct-drive-double-pendulum",
        "two links without gears",
        include_str!("../robots/direct-drive-double-pendulum.toml"),
    ),
    ("emps", "a positioning axis of which only recordings are at hand", include_str!("../robots/emps.toml")),
];

/// What is asked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Question {
    /// Name of the answer: a key of the robot file, `joint1.` or `joint2.` before those of a joint, `link1.` or `link2.`
    /// before those of a link.
    pub key: String,
    /// The question.
    pub text: &'static str,
    /// Unit of the answer; empty where it has none.
    pub unit: &'static str,
    /// What an empty answer means, where it means anything.
    pub default: Option<String>,
}

/// Why an answer is not taken.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{key} is {value}, but must be {limit}; {remedy}")]
pub struct AnswerError {
    /// Name of the answer.
    pub key: String,
    /// The answer.
    pub value: String,
    /// What would be accepted.
    pub limit: String,
    /// What to do about it.
    pub remedy: String,
}

/// Reads answers from a TOML file: `KEY = VALUE`, where tables are the part of a key before the dot.
pub fn read_answers(path: &Path) -> Result<BTreeMap<String, String>, FileError> {
    let table: toml::Table = TomlText::read(path)?.parse()?;
    let mut answers = BTreeMap::new();
    flatten("", &toml::Value::Table(table), &mut answers);
    Ok(answers)
}

/// Keys of nested tables joined with dots.
fn flatten(prefix: &str, value: &toml::Value, into: &mut BTreeMap<String, String>) {
    match value {
        toml::Value::Table(table) => {
            for (key, value) in table {
                let key = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
                flatten(&key, value, into);
            }
        }
        toml::Value::String(text) => {
            into.insert(prefix.into(), text.clone());
        }
        other => {
            into.insert(prefix.into(), other.to_string());
        }
    }
}

/// A robot as far as it is known.
#[derive(Clone, Debug)]
struct Draft {
    robot: Robot,
    links: [Link; 2],
}

/// Questions and the answers so far.
#[derive(Clone, Debug)]
pub struct Interview {
    draft: Draft,
    answered: usize,
}

impl Default for Interview {
    fn default() -> Self {
        Self::new()
    }
}

impl Interview {
    /// Nothing has been asked yet.
    pub fn new() -> Self {
        let link = Link { mass_kg: 1.0, centre_m: [0.0, 0.0], inertia_kg_m2: 0.1, motor_inertia_kg_m2: 1e-4 };
        let mut robot = Robot { gripper: None, ..Robot::paper() };
        for joint in &mut robot.joints {
            // Nothing of the paper's robot is taken for granted: a joint begins without direction, friction or limits that
            // would bind.
            joint.gear_ratio = 1.0;
            joint.viscous_friction_nm_s_per_rad = Some(0.0);
            joint.coulomb_friction_nm = Some(0.0);
        }
        Self { draft: Draft { robot, links: [link; 2] }, answered: 0 }
    }

    /// The next question; nothing when all are answered.
    pub fn question(&self) -> Option<Question> {
        let step = self.step()?;
        Some(Question {
            key: step.key(),
            text: step.text,
            unit: step.unit,
            default: (step.default)(&self.draft, step.index),
        })
    }

    fn step(&self) -> Option<Step> {
        steps(&self.draft.robot).into_iter().nth(self.answered)
    }

    /// Takes the answer to the current question, if it can be; otherwise the question stays.
    pub fn answer(&mut self, answer: &str) -> Result<(), AnswerError> {
        let Some(step) = self.step() else { return Ok(()) };
        let mut draft = self.draft.clone();
        let answer = answer.trim();
        let given = match (answer, (step.default)(&draft, step.index)) {
            ("", Some(default)) => default,
            _ => answer.to_string(),
        };
        let refuse = |limit: &str, remedy: &str| AnswerError {
            key: step.key(),
            value: if given.is_empty() { "not given".into() } else { given.clone() },
            limit: limit.into(),
            remedy: remedy.into(),
        };
        match step.put {
            Put::Text(put) => put(&mut draft, step.index, &given).map_err(|limit| refuse(limit, "choose one"))?,
            Put::Number(put) => {
                let number = given.parse::<f64>().ok().filter(|number| number.is_finite());
                let number =
                    number.ok_or_else(|| refuse("a finite number, such as 0.7 or 1e-3", "leave the unit out"))?;
                put(&mut draft, step.index, number);
            }
            Put::Positive(put) => {
                let number = given.parse::<f64>().ok().filter(|number| number.is_finite() && *number > 0.0);
                put(
                    &mut draft,
                    step.index,
                    number.ok_or_else(|| refuse("a number above 0", "a rough guess is enough"))?,
                );
            }
        }
        check(&step, &draft, &given)?;
        self.draft = draft;
        self.answered += 1;
        Ok(())
    }

    /// Goes past the current question without an answer, to see which come after it; what comes of it is no robot.
    pub fn pass(&mut self) {
        self.answered += 1;
    }

    /// The robot and its file, with remarks, when every question is answered.
    pub fn finish(mut self) -> Result<(Robot, String), SetupError> {
        let robot = &mut self.draft.robot;
        proposal::set_following_error_limit(robot);
        proposal::set_friction_switch(robot);
        if robot.kind == Kind::TwoLink {
            configuration(robot)?;
        }
        Ok((robot.clone(), text::with_remarks(robot)))
    }
}

/// Accepts an answer only if no check of the robot file speaks against this very value.
fn check(step: &Step, draft: &Draft, given: &str) -> Result<(), AnswerError> {
    let robot = &draft.robot;
    let refuse = |limit: String, remedy: String| AnswerError { key: step.key(), value: given.into(), limit, remedy };
    if let Err(error) = robot.check()
        && error.field == step.field
        && error.joint == step.joint()
    {
        return Err(refuse(error.limit.into(), error.remedy.into()));
    }
    if step.field == "loop_period_s"
        && robot.kind == Kind::TwoLink
        && let Err(SetupError::LoopPeriod(_)) = configuration(robot)
    {
        let offered = "one of the board's: 0.0007, 0.00035, 0.0001 or 0.00005 s".into();
        return Err(refuse(offered, "choose the longest that is a whole fraction of record_period_s".into()));
    }
    // A lead counts with its gain: each is checked when the last of the two is known.
    if step.field == "position_gain_a_per_count"
        && matches!(robot.joints[step.index].law, Law::Proportional(_))
        && let Err(error) = robot.check_gains()
        && error.index == step.index
    {
        return Err(refuse("a stable gain".into(), error.source.to_string()));
    }
    Ok(())
}
