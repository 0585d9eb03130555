//! Writes the cases of the hidden-effect benchmark: recordings of simulated robots with something wrong in them, and
//! what it is in a sealed file. `armid bench explain --dir DIR` scores them.
#![forbid(unsafe_code)]

use std::path::PathBuf;
use std::process::ExitCode;

use armid_tests::hidden_effects::case::Case;
use armid_tests::hidden_effects::plan::{Specification, TIERS};
use clap::Parser;

/// Writes the cases of the hidden-effect benchmark.
///
/// Every case is a folder case-NNNN with robot.toml, model.toml (in most cases), fit-1.csv, fit-2.csv, check-1.csv and
/// truth.toml, which only the scorer may read. The same seed and cases give the same files. Folders that are complete
/// are kept, so an interrupted run goes on where it was.
#[derive(Debug, Parser)]
struct Arguments {
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Which cases: smoke, standard, full, or parts such as effects=2,nulls=300,outside=1,pairs=40,tiers=clear+small
    #[arg(long, default_value = "standard", value_name = "SPEC")]
    cases: Specification,
    /// Seed of the whole benchmark
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Simulations at the same time; as many as there are processors if not given
    #[arg(long, value_name = "N")]
    jobs: Option<usize>,
    /// Print a table of the sizes instead of writing files
    #[arg(long)]
    sizes: bool,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn std::error::Error>> {
    let planned = arguments.cases.cases();
    let jobs = arguments.jobs.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    let order = shuffled(planned.len(), arguments.seed);
    let next = std::sync::atomic::AtomicUsize::new(0);
    let failure = std::sync::Mutex::new(None);
    let lines = std::sync::Mutex::new(vec![String::new(); planned.len()]);
    std::thread::scope(|scope| {
        for _ in 0..jobs.max(1) {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                    let Some(case) = planned.get(index) else { return };
                    if arguments.sizes {
                        let line = size_line(&Case::draw(case, arguments.seed, index as u64));
                        if let Ok(mut lines) = lines.lock() {
                            lines[index] = line;
                        }
                        continue;
                    }
                    // Names say nothing about what is inside.
                    let folder = arguments.out.join(format!("case-{:04}", order[index]));
                    if folder.join("truth.toml").is_file() {
                        continue;
                    }
                    let written = Case::draw(case, arguments.seed, index as u64).write(&folder);
                    if let Err(error) = written {
                        if let Ok(mut failure) = failure.lock() {
                            *failure = Some(format!("{}: {error}", folder.display()));
                        }
                        return;
                    }
                    if index % 50 == 49 {
                        eprintln!("{} of {} cases", index + 1, planned.len());
                    }
                }
            });
        }
    });
    if let Some(message) = failure.into_inner().ok().flatten() {
        return Err(message.into());
    }
    if arguments.sizes {
        println!("effect joint tier | error counts rms of joints 2 and 3 | command torque in % of Coulomb friction");
        for line in lines.into_inner().unwrap_or_default() {
            println!("{line}");
        }
        return Ok(());
    }
    println!("{} cases in {}", planned.len(), arguments.out.display());
    Ok(())
}

fn size_line(case: &Case) -> String {
    let [counts, of_coulomb] = case.sizes(&case.record());
    let names: Vec<String> = case.injected.iter().map(|effect| format!("{} {}", effect.name, effect.joint)).collect();
    let tier = TIERS.iter().find(|tier| **tier == case.planned.tier).map_or("", |tier| tier.name);
    format!(
        "{:<40} {:<7} | {:8.3} {:8.3} | {:8.2} {:8.2}",
        names.join(" + "),
        tier,
        counts[0],
        counts[1],
        100.0 * of_coulomb[0],
        100.0 * of_coulomb[1]
    )
}

/// The numbers of the cases' folders: a permutation decided by the seed.
fn shuffled(count: usize, seed: u64) -> Vec<usize> {
    let mut draw = armid_tests::hidden_effects::draw::Draw::of_case(seed, u64::MAX);
    let mut order: Vec<usize> = (0..count).collect();
    for last in (1..count).rev() {
        order.swap(last, draw.index(last + 1));
    }
    order
}
