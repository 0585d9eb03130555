//! `armid bench explain`: `explain` and its rivals on recordings with hidden effects.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use armid::explain_benchmark::answer::{self, Answer};
use armid::explain_benchmark::case::Case;
use armid::explain_benchmark::report::{self, Method};
use armid::explain_benchmark::score::Judged;
use armid::explain_benchmark::{screen, sindy};
use clap::Args;

use super::super::{CommandError, page, progress};
use super::Measured;

const EXAMPLES: &str = "Example:
  armid bench explain --dir cases";

/// Arguments of `bench explain`.
///
/// The cases come from a separate program, so that they share nothing with what is judged. In a checkout of the
/// project: `cargo run --ignore-rust-version --release -p armid-tests --bin hidden-effects -- --out DIR --cases full`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Explain {
    /// Folder of cases, written by the program `hidden-effects`
    #[arg(long, value_name = "FOLDER")]
    dir: PathBuf,
    /// Folder to keep every answer in; answers that are there already are not asked for again
    #[arg(long, value_name = "FOLDER")]
    results: Option<PathBuf>,
    /// The program to judge, if not this one
    #[arg(long, value_name = "PROGRAM")]
    program: Option<PathBuf>,
    /// Cases at the same time
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=256))]
    jobs: u16,
    /// Seed given to `explain`
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only the rivals, without `explain` itself
    #[arg(long)]
    rivals_only: bool,
}

impl Explain {
    pub fn measure(&self) -> Result<Measured, CommandError> {
        let failed = |path: &Path, error: std::io::Error| CommandError::Failed(format!("{}: {error}", path.display()));
        let cases = Case::all(&self.dir).map_err(|error| {
            let folder = self.dir.display();
            CommandError::Usage(format!("--dir {folder} cannot be read: {error}; name the folder of the cases"))
        })?;
        if cases.is_empty() {
            return Err(CommandError::Failed(format!(
                "{}: no case in it; write some with the program hidden-effects (see --help)",
                self.dir.display()
            )));
        }
        let results = self.results.clone().unwrap_or_else(|| self.dir.join("results"));
        std::fs::create_dir_all(&results).map_err(|error| failed(&results, error))?;
        let program = match &self.program {
            Some(program) => program.clone(),
            None => std::env::current_exe().map_err(CommandError::Output)?,
        };

        let mut methods: Vec<(&str, Vec<Judged>)> = Vec::new();
        let asked = |case: &Case| answer::explain(&program, case, self.seed);
        if !self.rivals_only {
            methods.push(("explain", self.judge("explain", &cases, &results, &asked)?));
        }
        methods.push(("best single regression", self.judge("screen", &cases, &results, &screen::answer)?));
        methods.push(("discrepancy SINDy", self.judge("sindy", &cases, &results, &sindy::answer)?));
        let methods: Vec<Method<'_>> = methods.iter().map(|(name, judged)| Method { name, judged }).collect();
        let program = program.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        Ok(Measured {
            title: "Hidden effects, named by explain and its rivals".into(),
            verdict: report::verdict(&methods),
            sections: report::sections(&methods),
            json: report::json(&methods),
            provenance: page::provenance()
                .fact("cases", format!("{} of {}", cases.len(), self.dir.display()))
                .fact("program judged", program)
                .seed(self.seed),
        })
    }

    /// Asks one method about every case, then opens the truths.
    fn judge(
        &self,
        method: &str,
        cases: &[Case],
        results: &Path,
        ask: &(dyn Fn(&Case) -> Answer + Sync),
    ) -> Result<Vec<Judged>, CommandError> {
        let bar = progress::bar(&format!("bench explain: {method}"), cases.len() as u64);
        let next = AtomicUsize::new(0);
        let answers = Mutex::new(vec![None; cases.len()]);
        std::thread::scope(|scope| {
            for _ in 0..self.jobs {
                scope.spawn(|| {
                    while let Some((index, case)) = {
                        let index = next.fetch_add(1, Ordering::Relaxed);
                        cases.get(index).map(|case| (index, case))
                    } {
                        let kept = results.join(format!("{}.{method}.json", case.name));
                        let answer = kept_answer(&kept).unwrap_or_else(|| {
                            let answer = ask(case);
                            // An answer that cannot be kept is asked for again next time; it still counts now.
                            if let Ok(text) = serde_json::to_vec_pretty(&answer) {
                                let _ = armid::write_file(&kept, &text);
                            }
                            answer
                        });
                        if let Ok(mut answers) = answers.lock() {
                            answers[index] = Some(answer);
                        }
                        bar.inc(1);
                    }
                });
            }
        });
        bar.finish_and_clear();
        let answers = answers.into_inner().unwrap_or_default();
        let mut judged = Vec::new();
        for (case, answer) in cases.iter().zip(answers) {
            let truth = case.open_truth()?;
            judged.push(Judged { case: case.name.clone(), truth, answer: answer.unwrap_or_default() });
        }
        Ok(judged)
    }
}

fn kept_answer(path: &Path) -> Option<Answer> {
    serde_json::from_slice(&std::fs::read(path).ok()?).ok()
}
