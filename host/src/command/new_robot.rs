//! `armid new-robot`.

use std::collections::BTreeMap;
use std::io::{BufRead as _, IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};

use armid::new_robot::{EXAMPLES, Interview, Question, read_answers};
use armid::robot::Robot;
use clap::Args;
use serde_json::json;

use super::CommandError;
use super::common::{advise, print, print_json};
use super::outputs::{FileKind, check_outputs};

const EXAMPLES_OF_USE: &str = "Without --answers and --set every value is asked for, with its unit and, in brackets, what an \
    empty answer means; each answer is checked at once. Where stdin is no terminal nothing is guessed: every question needs an \
    answer, or --defaults takes what an empty answer would mean.

Examples:
  armid new-robot --out robot.toml
  armid new-robot --example direct-drive-double-pendulum --out robot.toml
  armid new-robot --list                            every question with its key, for --answers and --set
  armid new-robot --answers answers.toml --set upper_arm_m=0.35 --defaults --out robot.toml
where answers.toml has lines such as: name = \"my arm\" and joint1.gear_ratio = 50. Joints and links count from 1; once a joint
has its name, joint_NAME and link_NAME mean the same.";

/// Arguments of `new-robot`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES_OF_USE)]
pub struct NewRobot {
    /// Robot file to write; without it, stdout
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Answers: a TOML file of KEY = VALUE
    #[arg(long, value_name = "FILE")]
    answers: Option<PathBuf>,
    /// One answer; may be repeated, and comes before those of --answers
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Take what an empty answer would mean where no answer is given
    #[arg(long)]
    defaults: bool,
    /// Ask on stdin although it is no terminal
    #[arg(long, conflicts_with = "defaults")]
    ask: bool,
    /// Show every question of a two-link arm, or with --set kind=single-axis of one axis
    #[arg(long, conflicts_with_all = ["out", "ask"])]
    list: bool,
    /// Write an example instead: puma-560, direct-drive-double-pendulum or emps
    #[arg(long, value_name = "NAME", value_parser = EXAMPLES.map(|(name, _, _)| name), conflicts_with_all = ["answers", "set", "list"])]
    example: Option<String>,
    /// Replace a robot file that is there already
    #[arg(long)]
    force: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl NewRobot {
    pub fn run(&self) -> Result<(), CommandError> {
        if let Some(out) = &self.out {
            if out.exists() && !armid::is_stream(out) && !self.force {
                return Err(CommandError::Usage(format!(
                    "{} exists; choose another --out, or replace it with --force",
                    out.display()
                )));
            }
            check_outputs([(out.as_path(), FileKind::Robot)], self.answers.as_deref())?;
        }
        if let Some(wanted) = &self.example {
            let text = EXAMPLES.iter().find(|(name, _, _)| name == wanted).map_or("", |(_, _, text)| text);
            let robot = Robot::from_bytes(Path::new(wanted), text.into())?;
            return self.put(&robot, text);
        }
        let mut given = self.given()?;
        if self.list {
            return self.show_questions(&mut given);
        }
        let interview = self.interview(&mut given)?;
        let (robot, text) = interview.finish()?;
        self.put(&robot, &text)
    }

    /// The answers that the command line brings.
    fn given(&self) -> Result<BTreeMap<String, String>, CommandError> {
        let mut given = BTreeMap::new();
        if let Some(path) = &self.answers {
            given = read_answers(path)?;
        }
        for pair in &self.set {
            let (key, value) = pair
                .split_once('=')
                .ok_or_else(|| CommandError::Usage(format!("--set {pair} is not KEY=VALUE, such as name=arm")))?;
            given.insert(key.trim().into(), value.trim().into());
        }
        Ok(given)
    }

    fn interview(&self, given: &mut BTreeMap<String, String>) -> Result<Interview, CommandError> {
        let mut interview = Interview::new();
        let asks = !self.defaults && (self.ask || std::io::stdin().is_terminal());
        let mut missing = Vec::new();
        while let Some(question) = interview.question() {
            if let Some(answer) = take(given, &question) {
                match interview.answer(&answer) {
                    Ok(()) => {}
                    // What it is wrong with may be what stands for a missing answer: those are told first.
                    Err(_) if !missing.is_empty() => interview.pass(),
                    Err(error) => return Err(CommandError::Usage(error.to_string())),
                }
            } else if asks {
                ask(&mut interview, &question)?;
            } else if self.defaults && question.default.is_some() {
                interview.answer("").map_err(|error| CommandError::Usage(error.to_string()))?;
            } else {
                // What follows is asked for as well, so that all that is missing is told at once.
                missing.push(question.key.clone());
                skip(&mut interview, &question);
            }
        }
        if !missing.is_empty() {
            let remedy = "give them by --answers or --set, or run it in a terminal to be asked; --defaults takes the usual \
                          value where there is one";
            return Err(CommandError::Usage(format!("no answer to {}; {remedy}", missing.join(", "))));
        }
        if let Some(key) = given.keys().next() {
            return Err(CommandError::Usage(format!("{key} is asked of no robot of this kind; --list shows the keys")));
        }
        Ok(interview)
    }

    fn show_questions(&self, given: &mut BTreeMap<String, String>) -> Result<(), CommandError> {
        let mut interview = Interview::new();
        let mut questions = Vec::new();
        while let Some(question) = interview.question() {
            match take(given, &question) {
                Some(answer) => {
                    interview.answer(&answer).map_err(|error| CommandError::Usage(error.to_string()))?;
                }
                None => skip(&mut interview, &question),
            }
            questions.push(question);
        }
        if self.json {
            let each =
                |question: &Question| json!({"key": question.key, "question": question.text, "unit": question.unit});
            return print_json(&json!({"questions": questions.iter().map(each).collect::<Vec<_>>()}));
        }
        let line = |question: &Question| {
            let unit = if question.unit.is_empty() { String::new() } else { format!(" ({})", question.unit) };
            format!("{:<38} {}{unit}", question.key, question.text)
        };
        print(questions.iter().map(line).collect::<Vec<_>>().join("\n"))
    }

    fn put(&self, robot: &Robot, text: &str) -> Result<(), CommandError> {
        let Some(out) = &self.out else {
            return if self.json { print_json(&json!({"robot": robot.name, "toml": text})) } else { print(text) };
        };
        armid::write_file(out, text.as_bytes())?;
        if self.json {
            return print_json(&json!({"robot": robot.name, "out": out}));
        }
        print(format!("{}: {:?}", out.display(), robot.name))
    }
}

/// The answer that was given to a question, by either name of it.
fn take(given: &mut BTreeMap<String, String>, question: &Question) -> Option<String> {
    given.remove(&question.key).or_else(|| given.remove(question.named_key.as_ref()?))
}

/// Asks until there is an answer that can be.
fn ask(interview: &mut Interview, question: &Question) -> Result<(), CommandError> {
    let unit = if question.unit.is_empty() { String::new() } else { format!(", {}", question.unit) };
    let default = question.default.as_ref().map(|default| format!(" [{default}]")).unwrap_or_default();
    let whose = if question.whose.is_empty() { String::new() } else { format!("({}) ", question.whose) };
    loop {
        // What is asked must be seen before the answer is waited for; a stderr that is closed shows nothing anyway.
        let mut stderr = std::io::stderr();
        let _ = write!(stderr, "{whose}{}{unit}{default}: ", question.text).and_then(|()| stderr.flush());
        let mut line = String::new();
        let read = std::io::stdin().lock().read_line(&mut line);
        if !read.is_ok_and(|bytes| bytes > 0) {
            return Err(CommandError::Usage(format!("the answers ended before {}", question.key)));
        }
        match interview.answer(&line) {
            Ok(()) => return Ok(()),
            Err(error) => advise(format!("{error}")),
        }
    }
}

/// Goes past a question that has no answer, to see which come after it.
fn skip(interview: &mut Interview, question: &Question) {
    let default = question.default.clone().unwrap_or_else(|| "1".into());
    if interview.answer(&default).is_err() {
        interview.pass();
    }
}
