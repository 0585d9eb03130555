//! What `explain` (or a rival) answered about a case: its JSON, kept so that an interrupted run goes on.

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

use super::case::Case;

/// An answer, with what it took.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Answer {
    /// Time taken in s.
    pub seconds: f64,
    /// The verdict, if there was one.
    pub verdict: Option<Verdict>,
    /// Why there was none.
    #[serde(default)]
    pub failure: String,
}

/// The JSON object of `explain`, as far as it is scored.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Verdict {
    /// "named", "none", "unknown" or "partial".
    pub verdict: String,
    /// Named effects, in the order of acceptance.
    #[serde(default)]
    pub effects: Vec<Named>,
    /// How far measurement and model are apart.
    #[serde(default)]
    pub gap: Option<Gap>,
}

/// A named effect.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Named {
    /// Its name.
    pub name: String,
    /// Its joint, or "both".
    pub joint: String,
    /// Names that explain the recordings as well; contains `name`.
    #[serde(default)]
    pub class: Vec<String>,
    /// Parameters found.
    #[serde(default)]
    pub parameters: BTreeMap<String, Estimate>,
}

/// A parameter found.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Estimate {
    /// Its value.
    pub value: f64,
    /// Its standard error, if stated.
    #[serde(default)]
    pub standard_error: Option<f64>,
}

/// The gap between measurement and model in counts rms.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Gap {
    /// What a right model leaves.
    pub floor: f64,
    /// On the recordings kept back.
    #[serde(default)]
    pub held_out: Option<HeldOut>,
}

/// The gap on the recordings kept back.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct HeldOut {
    /// With the extended model.
    pub after: f64,
}

impl Named {
    /// Whether `name` is among what the answer holds possible.
    pub fn may_be(&self, name: &str) -> bool {
        self.name == name || self.class.iter().any(|member| member == name)
    }

    /// How many names it leaves possible; at least 1.
    pub fn class_size(&self) -> usize {
        self.class.len().max(1)
    }
}

/// Runs `explain --json` of the program `armid` on a case.
pub fn explain(armid: &Path, case: &Case, seed: u64) -> Answer {
    let mut command = Command::new(armid);
    command.args(["explain", "--json", "--seed", &seed.to_string(), "--robot"]).arg(case.robot());
    if let Some(model) = &case.model {
        command.arg("--model").arg(model);
    }
    command.args(&case.fit);
    for check in &case.check {
        command.arg("--check").arg(check);
    }
    // Every case is timed with nothing kept from another run.
    command.env("ARMID_CACHE", "");
    let started = Instant::now();
    let output = command.output();
    let seconds = started.elapsed().as_secs_f64();
    let failed = |failure: String| Answer { seconds, verdict: None, failure };
    let output = match output {
        Ok(output) => output,
        Err(error) => return failed(format!("{}: {error}", armid.display())),
    };
    match serde_json::from_slice(&output.stdout) {
        Ok(verdict) => Answer { seconds, verdict: Some(verdict), failure: String::new() },
        Err(error) => {
            let said = String::from_utf8_lossy(&output.stderr);
            let last = said.lines().last().unwrap_or_default();
            failed(format!("exit {:?}, no JSON ({error}): {last}", output.status.code()))
        }
    }
}
