//! A robot file from answers: questions one after the other, each answer checked as the robot file itself is.
//!
//! Masses, centres and inertias are asked as rough guesses: they give the search ranges, the arm to expect and, with them,
//! the gains that are proposed.

mod proposal;
mod questions;
mod text;

use std::collections::BTreeMap;
use std::path::Path;

use crate::board_setup::{
    LEAST_VISCOUS_FRICTION_NM_S_PER_RAD, SetupError, check_full_scale, configuration, loop_periods_s,
};
use crate::file_error::FileError;
use crate::links::Link;
use crate::number_text::significant;
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
    /// The same by the joint's own name, `joint_elbow.` or `link_elbow.`, as soon as it has one.
    pub named_key: Option<String>,
    /// Which joint or link is asked about, for people; empty where it is the robot.
    pub whose: String,
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
            named_key: step.named_key(&self.draft),
            whose: step.whose(&self.draft),
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
        if robot.kind == Kind::TwoLink {
            proposal::set_following_error_limit(robot);
            proposal::set_friction_switch(robot);
            configuration(robot)?;
        }
        Ok((robot.clone(), text::with_remarks(robot)))
    }
}

/// Accepts an answer only if no check of the robot file speaks against this very value.
fn check(step: &Step, draft: &Draft, given: &str) -> Result<(), AnswerError> {
    let robot = &draft.robot;
    let refuse = |limit: String, remedy: String| AnswerError { key: step.key(), value: given.into(), limit, remedy };
    if robot.kind == Kind::TwoLink {
        check_for_board(step, robot).map_err(|(limit, remedy)| refuse(limit, remedy))?;
    }
    if let Err(error) = robot.check()
        && error.field == step.field
        && error.joint == step.joint()
    {
        return Err(refuse(error.limit.into(), error.remedy.into()));
    }
    // A lead counts with its gain: each is checked when the last of the two is known.
    if step.field == "position_gain_a_per_count"
        && matches!(robot.joints[step.index].law, Law::Proportional(_))
        && let Err(error) = robot.check_gains()
        && error.index == step.index
    {
        let limit_a_per_count = error.source.limit_nm_per_count / robot.joints[step.index].torque_constant_nm_per_a;
        let limit = format!("stable, below {} A/count", significant(limit_a_per_count, 4));
        let remedy = format!("{} sets the limit: lower the gain, or change the lead", error.source.cause);
        return Err(refuse(limit, remedy));
    }
    Ok(())
}

/// Accepts only what the board drives a robot with; else what would be accepted, and what to do.
fn check_for_board(step: &Step, robot: &Robot) -> Result<(), (String, String)> {
    let joint = &robot.joints[step.index];
    match step.field {
        "record_period_s"
            if (1e-5..=0.1).contains(&robot.record_period_s) && loop_periods_s(robot.record_period_s).is_empty() =>
        {
            let limit = "1 to 320 times one of the board's loop periods: 0.0007, 0.00035, 0.0001 or 0.00005 s";
            return Err((limit.into(), "choose a multiple of one of them".into()));
        }
        "loop_period_s" => {
            let offered = loop_periods_s(robot.record_period_s);
            if !offered.iter().any(|period_s| (period_s / robot.loop_period_s - 1.0).abs() < 1e-6) {
                let offered: Vec<String> = offered.iter().map(f64::to_string).collect();
                let limit = format!(
                    "one of the board's that is a whole fraction of record_period_s: {} s",
                    offered.join(" or ")
                );
                return Err((limit, "choose the longest unless the gain needs a shorter one".into()));
            }
        }
        "current_full_scale_a" if joint.current_full_scale_a > 0.0 => {
            if let Err(SetupError::FullScale { least_a, .. }) = check_full_scale(joint) {
                let limit = format!(
                    "at least {least_a} A: the board switches off at 95 % of it, the amplifier gives {} A",
                    joint.current_limit_a
                );
                return Err((limit, "give the range of the sensor, or lower current_limit_a".into()));
            }
        }
        "viscous_friction_nm_s_per_rad" => {
            let value = joint.viscous_friction_nm_s_per_rad.unwrap_or(0.0);
            if (0.0..LEAST_VISCOUS_FRICTION_NM_S_PER_RAD).contains(&value) {
                let limit = format!("at least {LEAST_VISCOUS_FRICTION_NM_S_PER_RAD:e} N m s/rad");
                return Err((limit, "give an estimate, rather too small than too large".into()));
            }
        }
        _ => {}
    }
    Ok(())
}
