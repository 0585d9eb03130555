//! `armid bench ga`: how surely and how fast the genetic algorithm finds the minimum of the paper's objective, beside
//! differential evolution and CMA-ES, on the raw signals and up the filter ladder 8, 12, 15 Hz, raw; and beside what
//! `armid identify` does by default, which needs no search ranges but simulates sensitivities as well.
//!
//! One simulated robot in the default loop, the paper's movement; f1..f9 sought, friction known. Every search may judge
//! the same number of candidates. It has succeeded when the root mean square difference is within 1.05 of the best that
//! any search found; how many came within 1.05 of what the true values leave is told too. The loop rings, and values that
//! ring along by luck leave less than the true ones: `identify` searches for them last, and does not take them.

use armid::client::{Client, Pose};
use armid::hidden_robot::HiddenRobot;
use armid::identify::{
    Experiment, FrictionMode, Generation, Judge, LADDER_HZ, Options, Parameter, Sought, Values, acceptable, identify,
};
use armid::link::SimulatedBoard;
use armid::recording::Mode;
use armid::report::{Cell, Content, Ink, Line, Picture, Section, Table};
use armid::robot::Robot;
use armid::searchers::{Problem, differential_evolution, evolution_strategy, random};
use clap::Args;
use rand_core::SeedableRng;
use rand_pcg::Pcg64Mcg;
use serde_json::json;
use shared::arm::PARAMETERS;
use shared::genetic::{Coding, Genetic, Range, Settings};
use shared::plant::Plant;

use super::super::common::TrajectoryArguments;
use super::super::run::Run;
use super::super::{CommandError, page, progress};
use super::{Measured, seeds};

/// The paper's movement in s.
const PERIOD_S: f64 = 3.65;
/// Root mean square difference, as a multiple of the best known, that counts as found.
const FOUND: f64 = 1.05;

const EXAMPLES: &str = "Example:
  armid bench ga --seeds 50";

/// Arguments of `bench ga`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Ga {
    /// How many searches of each kind
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    seeds: u64,
    /// Seed of the hidden robot and of the first search
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Candidates each search may judge
    #[arg(long, value_name = "N", default_value_t = 12_000, value_parser = clap::value_parser!(u32).range(400..=10_000_000))]
    evaluations: u32,
    /// Search only this share of the search ranges, around a point that is this share off the truth at most
    #[arg(long, value_name = "SHARE", value_parser = share)]
    around: Option<f64>,
}

fn share(text: &str) -> Result<f64, String> {
    let share: f64 = text.parse().map_err(|_| format!("{text:?} is not a number"))?;
    if share > 0.0 && share <= 1.0 { Ok(share) } else { Err(format!("{share} is not above 0 and at most 1")) }
}

/// A kind of search.
#[derive(Clone, Copy)]
enum Searcher {
    Genetic(Settings),
    DifferentialEvolution,
    EvolutionStrategy,
}

/// The searchers compared, by name.
fn searchers() -> Vec<(&'static str, Searcher)> {
    let paper = Settings::paper();
    let gray = Settings { coding: Coding::Gray, ..paper };
    vec![
        ("the paper's genetic algorithm", Searcher::Genetic(paper)),
        ("the same, Gray coding", Searcher::Genetic(gray)),
        ("binary, migration every 5", Searcher::Genetic(Settings { migration_interval: 5, ..paper })),
        ("Gray, migration every 5", Searcher::Genetic(Settings { migration_interval: 5, ..gray })),
        ("its defaults: Gray, every 5, 2 bits flip", Searcher::Genetic(Settings::default())),
        ("differential evolution", Searcher::DifferentialEvolution),
        ("CMA-ES with restarts", Searcher::EvolutionStrategy),
    ]
}

/// What is drawn together.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Genetic,
    Other,
}

/// One kind of search, many times.
struct Outcome {
    name: String,
    kind: Kind,
    /// Whether it went up the filter ladder.
    ladder: bool,
    /// Of each search: every improvement of its best raw objective, as (candidates judged, objective in counts²).
    courses: Vec<Vec<(usize, f64)>>,
}

impl Outcome {
    fn finals(&self) -> Vec<f64> {
        let mut finals: Vec<f64> =
            self.courses.iter().map(|course| course.last().map_or(f64::INFINITY, |last| last.1)).collect();
        finals.sort_by(f64::total_cmp);
        finals
    }

    /// After how many candidates each search that succeeded had, sorted.
    fn reached(&self, target_counts2: f64) -> Vec<usize> {
        let first = |course: &Vec<(usize, f64)>| course.iter().find(|step| step.1 <= target_counts2).map(|step| step.0);
        let mut reached: Vec<usize> = self.courses.iter().filter_map(first).collect();
        reached.sort_unstable();
        reached
    }

    /// The share of searches that came to `target_counts2`.
    fn success(&self, target_counts2: f64) -> f64 {
        self.reached(target_counts2).len() as f64 / self.courses.len() as f64
    }

    /// The median over the searches of the least objective after so many candidates, counts²; infinite where most have
    /// none yet.
    fn median_after(&self, judged: usize) -> f64 {
        let least = |course: &Vec<(usize, f64)>| {
            let so_far = course.iter().take_while(|step| step.0 <= judged).last();
            so_far.map_or(f64::INFINITY, |step| step.1)
        };
        let mut least: Vec<f64> = self.courses.iter().map(least).collect();
        least.sort_by(f64::total_cmp);
        middle(&least).unwrap_or(f64::INFINITY)
    }
}

impl Ga {
    pub fn measure(&self) -> Result<Measured, CommandError> {
        let robot = Robot::paper();
        let truth = HiddenRobot::draw(&robot, self.seed);
        let robot = truth.with_known_friction(&robot);
        let configuration = armid::board_setup::configuration(&robot)?;
        let mut client = Client::connect(Box::new(SimulatedBoard::new(&robot, truth.clone(), self.seed)))?;
        client.prepare(&configuration, Pose::DefaultsTo([0.0; 2]), false)?;
        let movement = TrajectoryArguments::paper(PERIOD_S).prepare(&robot)?;
        let run =
            Run { robot: &robot, movement: &movement, mode: Mode::P, seed: Some(self.seed), path: "bench.csv".into() };
        let recording = run.on(&mut client)?.whole()?;
        let experiment = Experiment::new(&robot, std::slice::from_ref(&recording))?;
        let mut known = Values::of_robot(&robot);
        known.f = truth.plant(&robot).arm.f;
        for joint in 0..robot.joints.len() {
            let drive = &truth.plant(&robot).drives[joint];
            known.set(Parameter::TorqueOffset(joint), drive.torque_offset_nm);
        }

        let searchers = searchers();
        let bar = progress::bar("bench ga", (2 * searchers.len() as u64 + 1) * self.seeds);
        let mut outcomes = Vec::new();
        for ladder in [false, true] {
            for (name, searcher) in &searchers {
                let courses = (self.seed..self.seed + self.seeds)
                    .map(|seed| {
                        let course = self.search(&experiment, &known, *searcher, ladder, seed);
                        bar.inc(1);
                        course
                    })
                    .collect::<Result<Vec<_>, CommandError>>()?;
                let kind = if matches!(searcher, Searcher::Genetic(_)) { Kind::Genetic } else { Kind::Other };
                let name = format!("{name}{}", if ladder { ", ladder" } else { "" });
                outcomes.push(Outcome { name, kind, ladder, courses });
            }
        }
        let sought = Sought { friction: FrictionMode::Known, ..Sought::default() };
        let courses = (self.seed..self.seed + self.seeds)
            .map(|seed| {
                let options = Options { sought, seed, ..Options::default() };
                let found = identify(&robot, std::slice::from_ref(&recording), &[], &options, &|_| ())?;
                bar.inc(1);
                let fitted = found.evaluations - found.generations.last().map_or(0, |last| last.evaluations);
                let searched = |generation: &Generation| (fitted + generation.evaluations, generation.best_counts2);
                let course: Vec<(usize, f64)> = found.generations.iter().map(searched).collect();
                Ok((course, vec![(found.evaluations, found.objective_counts2)]))
            })
            .collect::<Result<Vec<_>, CommandError>>()?;
        let (searched, taken) = courses.into_iter().unzip();
        for (what, courses) in [("search", searched), ("result", taken)] {
            let name = format!("armid identify, no guess: its {what}");
            outcomes.push(Outcome { name, kind: Kind::Other, ladder: false, courses });
        }
        bar.finish_and_clear();
        let found = outcomes.iter().flat_map(Outcome::finals);
        let truth_counts2 = experiment.objective_counts2(&known);
        let best_counts2 = found.fold(truth_counts2, f64::min);
        let scores = [best_counts2, truth_counts2];
        let (section, json) = self.scored(&outcomes, scores, experiment.samples());
        let success = |outcome: &Outcome| 100.0 * outcome.success(FOUND * FOUND * best_counts2);
        let rivals = outcomes.iter().max_by(|one, other| success(one).total_cmp(&success(other)));
        Ok(Measured {
            title: "Searches compared".into(),
            verdict: rivals.map_or_else(String::new, |best| {
                format!("Found most surely by {}: {:.0} % of {} searches.", best.name, success(best), self.seeds)
            }),
            sections: vec![section.pictures(pictures(&outcomes, self.evaluations, experiment.samples()))],
            json,
            provenance: page::provenance().robot(&robot).fact("seeds", seeds(self.seed, self.seeds)),
        })
    }

    /// The course of one search.
    fn search(
        &self,
        experiment: &Experiment,
        known: &Values,
        searcher: Searcher,
        ladder: bool,
        seed: u64,
    ) -> Result<Vec<(usize, f64)>, CommandError> {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let f: Vec<Parameter> = (0..PARAMETERS).map(Parameter::F).collect();
        let ranges: Vec<[f64; 2]> = (0..PARAMETERS)
            .map(|index| {
                let [low, high] = experiment.robot.search[index];
                let Some(share) = self.around else { return [low, high] };
                let reach = share * (high - low);
                let centre = known.f[index] + reach * (random::uniform(&mut random) - 0.5);
                [centre - reach, centre + reach]
            })
            .collect();
        let stages = if ladder { LADDER_HZ.len() + 1 } else { 1 };
        let mut raw = Judge::new(experiment);
        let mut course: Vec<(usize, f64)> = Vec::new();
        let mut judge = |stage: usize, judged: usize, candidates: &[Vec<f64>]| {
            let values: Vec<Values> = candidates
                .iter()
                .map(|genes| {
                    let inside: Vec<f64> =
                        genes.iter().zip(&ranges).map(|(gene, [low, high])| low + gene * (high - low)).collect();
                    known.with(&f, &inside)
                })
                .collect();
            if stage + 1 < stages {
                return smoothed(experiment, &values, LADDER_HZ[stage]);
            }
            let objectives = raw.objectives_counts2(&values);
            for (index, &objective) in objectives.iter().enumerate() {
                if course.last().is_none_or(|last| objective < last.1) {
                    course.push((judged + index + 1, objective));
                }
            }
            objectives
        };
        let mut problem = Problem::new(PARAMETERS, self.evaluations as usize, stages, &mut judge);
        match searcher {
            Searcher::Genetic(settings) => genetic(&mut problem, settings, random)?,
            Searcher::DifferentialEvolution => differential_evolution::run(&mut problem, &mut random),
            Searcher::EvolutionStrategy => {
                evolution_strategy::run(&mut problem, &evolution_strategy::Settings::default(), &mut random)
            }
        }
        Ok(course)
    }

    /// How surely and how fast each found the least objective known, and what the true values leave.
    fn scored(
        &self,
        outcomes: &[Outcome],
        [best_counts2, truth_counts2]: [f64; 2],
        samples: usize,
    ) -> (Section, serde_json::Value) {
        let [target_counts2, as_true_counts2] = [best_counts2, truth_counts2].map(|counts2| FOUND * FOUND * counts2);
        let mut table = Table::new([
            "search",
            "success, %",
            "as true, %",
            "evaluations until success",
            "difference at the end, counts rms",
        ]);
        let mut searches = Vec::new();
        for outcome in outcomes {
            let success = [target_counts2, as_true_counts2].map(|target| outcome.success(target));
            let evaluations = middle(&outcome.reached(target_counts2));
            let rms_counts = middle(&outcome.finals()).map(|counts2| rms(counts2, samples));
            table = table.row([
                Cell::from(outcome.name.as_str()),
                Cell::fixed(100.0 * success[0], 0),
                Cell::fixed(100.0 * success[1], 0),
                evaluations.map_or(Cell::Missing, Cell::count),
                Cell::optional(rms_counts, |rms| Cell::fixed(rms, 3)),
            ]);
            searches.push(json!({
                "name": outcome.name,
                "success_rate": success[0],
                "success_rate_of_true_values": success[1],
                "median_evaluations": evaluations,
                "median_rms_counts": rms_counts,
            }));
        }
        let section = Section::new("Searches").table(table).text(format!(
            "Success: within {FOUND} of the best known difference, {:.3} counts rms; as true: within {FOUND} of the {:.3} that \
             the true values leave, less being luck with the ringing. Evaluations: candidates judged until success, the \
             median of the searches that succeeded. Difference at the end: the median. {} searches of {} candidates each.",
            rms(best_counts2, samples),
            rms(truth_counts2, samples),
            self.seeds,
            self.evaluations
        ));
        let json = json!({
            "seeds": self.seeds,
            "seed": self.seed,
            "evaluations": self.evaluations,
            "around": self.around,
            "best_rms_counts": rms(best_counts2, samples),
            "true_rms_counts": rms(truth_counts2, samples),
            "searches": searches,
        });
        (section, json)
    }
}

/// Root mean square difference of an objective, counts.
fn rms(objective_counts2: f64, samples: usize) -> f64 {
    (objective_counts2 / (2 * samples) as f64).sqrt()
}

/// The median of the least differences so far, over the candidates judged: the genetic algorithms, and the others.
fn pictures(outcomes: &[Outcome], evaluations: u32, samples: usize) -> Vec<Picture> {
    const POINTS: u32 = 120;
    let course = |(place, outcome): (usize, &&Outcome)| {
        let at = (1..=POINTS).map(|point| (u64::from(evaluations) * u64::from(point) / u64::from(POINTS)) as usize);
        let points = at.map(|judged| (judged as f64, rms(outcome.median_after(judged), samples)));
        // Before half of the searches have judged their first raw candidate there is none.
        Line::new(outcome.name.as_str(), Ink::Nth(place), points.filter(|point| point.1.is_finite()).collect())
    };
    let of = |title: &str, wanted: &dyn Fn(&Outcome) -> bool| {
        let outcomes: Vec<&Outcome> = outcomes.iter().filter(|outcome| wanted(outcome)).collect();
        let lines = outcomes.iter().enumerate().map(course).collect();
        let axes = ["candidates judged", "difference, counts rms"];
        Picture::of(format!("Least difference so far: {title}"), axes, Content::LogarithmicLines(lines))
    };
    vec![
        of("genetic algorithms", &|one| one.kind == Kind::Genetic && !one.ladder),
        of("genetic algorithms, up the ladder", &|one| one.kind == Kind::Genetic && one.ladder),
        of("the others", &|one| one.kind == Kind::Other),
    ]
}

/// The median of sorted values.
fn middle<T: Copy>(sorted: &[T]) -> Option<T> {
    sorted.get(sorted.len() / 2).copied()
}

/// Spends the budget by the genetic algorithm.
fn genetic(problem: &mut Problem, settings: Settings, random: Pcg64Mcg) -> Result<(), CommandError> {
    let unit = [Range { low: 0.0, high: 1.0 }; PARAMETERS];
    let mut genetic = Genetic::<PARAMETERS, 20, 4, _>::new(settings, unit, random)
        .map_err(|error| CommandError::Failed(error.to_string()))?;
    let mut stage = None;
    while !problem.is_over() {
        let now = Some(problem.stage());
        let mut objective = |candidates: &[[f64; PARAMETERS]], objectives: &mut [f64]| {
            let candidates: Vec<Vec<f64>> = candidates.iter().map(|genes| genes.to_vec()).collect();
            objectives.copy_from_slice(&problem.judge(&candidates));
        };
        if stage == now {
            genetic.step(&mut objective);
        } else {
            genetic.initialise(&mut objective);
            stage = now;
        }
    }
    Ok(())
}

/// The objectives below a frequency; infinite for what no arm could be.
fn smoothed(experiment: &Experiment, values: &[Values], cutoff_hz: f64) -> Vec<f64> {
    let mut objectives = vec![f64::INFINITY; values.len()];
    let possible: Vec<usize> = (0..values.len()).filter(|&index| acceptable(experiment, &values[index])).collect();
    let plants: Vec<Plant<f64>> = possible.iter().map(|&index| values[index].plant(experiment.robot)).collect();
    let judged = experiment.smoothed_objectives_counts2(&plants, cutoff_hz).unwrap_or_default();
    for (index, objective) in possible.into_iter().zip(judged) {
        objectives[index] = objective;
    }
    objectives
}
