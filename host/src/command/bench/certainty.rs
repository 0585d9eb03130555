//! `armid bench certainty`: whether standard errors hold, on many robots that nobody has seen.
//!
//! Each robot is drawn around the reference robot and makes two movements (T = 3.65 and 5 s) under the position loop,
//! without noise and with a random torque at the motors; `identify` sees the recordings and a robot file whose friction is
//! 20 % off.

use armid::client::{Client, Pose};
use armid::hidden_robot::HiddenRobot;
use armid::identify::{Identification, Options, Parameter, identify};
use armid::link::{SimulatedBoard, TorqueNoise};
use armid::recording::{Mode, Recording};
use armid::report::{Cell, Content, Ink, Interval, Intervals, Line, Picture, Section, Table};
use armid::robot::{Law, Robot};
use clap::Args;
use rayon::prelude::*;
use serde_json::{Value, json};
use shared::arm::{PARAMETERS, REFERENCE_F};

use super::super::common::TrajectoryArguments;
use super::super::run::Run;
use super::super::{CommandError, page, progress};
use super::{Measured, seeds};

/// The two movements in s.
const PERIODS_S: [f64; 2] = [3.65, 5.0];
/// How far f may be off: a share of the reference value, and an absolute bound for the small f3, f5 and f8.
const ALLOWED_SHARE: f64 = 0.005;
const ALLOWED_SMALL: f64 = 0.005;
/// The small ones by index.
const SMALL: [usize; 3] = [2, 4, 7];
/// Memory of the random torque in s.
const CORRELATION_TIME_S: f64 = 0.05;
/// The paper's loop: gains in N m of motor torque per count, and the period that survives them.
const STIFF_GAINS_NM_PER_COUNT: [f64; 2] = [0.096, 0.094];
const STIFF_LOOP_PERIOD_S: f64 = 50e-6;

const EXAMPLES: &str = "Example:
  armid bench certainty --robots 60 --torque-noise 0.2";

/// Arguments of `bench certainty`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Certainty {
    /// How many robots
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    robots: u64,
    /// Seed of the first robot; the others take the ones after it
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Random torque in per cent of each motor's own rms torque; may be given several times
    #[arg(long, value_name = "PERCENT", default_values_t = [0.0, 1.0])]
    torque_noise: Vec<f64>,
    /// The paper's loop instead of the default one: 50 µs at gains that hold ±10 counts
    #[arg(long)]
    stiff: bool,
}

impl Certainty {
    pub fn measure(&self) -> Result<Measured, CommandError> {
        if let Some(wrong) = self.torque_noise.iter().find(|percent| !(0.0..=100.0).contains(*percent)) {
            return Err(CommandError::Usage(format!("--torque-noise {wrong} is not from 0 to 100 per cent")));
        }
        let mut robot = Robot::paper();
        if self.stiff {
            robot.loop_period_s = STIFF_LOOP_PERIOD_S;
            for (joint, gain) in robot.joints.iter_mut().zip(STIFF_GAINS_NM_PER_COUNT) {
                if let Law::Proportional(position_loop) = &mut joint.law {
                    position_loop.gain_a_per_count = gain / joint.torque_constant_nm_per_a;
                }
            }
        }
        let bar = progress::bar("bench certainty", self.robots * self.torque_noise.len() as u64);
        let mut studies = Vec::new();
        for &percent in &self.torque_noise {
            let seeds: Vec<u64> = (self.seed..self.seed + self.robots).collect();
            let judged: Result<Vec<Judged>, CommandError> = seeds
                .into_par_iter()
                .map(|seed| {
                    let judged = judge(&robot, seed, percent);
                    bar.inc(1);
                    judged
                })
                .collect();
            studies.push(Study { percent, judged: judged? });
        }
        bar.finish_and_clear();
        let stiff = if self.stiff { "the paper's: 50 µs at gains that hold ±10 counts" } else { "the default one" };
        Ok(Measured {
            title: format!("{} robots identified, and their standard errors judged", self.robots),
            verdict: studies.iter().map(Study::verdict).collect::<Vec<_>>().join(" "),
            sections: studies.iter().map(Study::section).collect(),
            json: json!({
                "robots": self.robots, "seed": self.seed, "stiff": self.stiff,
                "studies": studies.iter().map(Study::to_json).collect::<Vec<_>>(),
            }),
            provenance: page::provenance()
                .robot(&robot)
                .fact("loop", stiff)
                .fact("seeds", seeds(self.seed, self.robots)),
        })
    }
}

/// One robot's identification with its truth.
struct Judged {
    found: Identification,
    truth: HiddenRobot,
}

impl Judged {
    fn truth_of(&self, parameter: Parameter) -> f64 {
        match parameter {
            Parameter::F(index) => self.truth.f[index],
            Parameter::Viscous(joint) => self.truth.viscous_nm_s_per_rad[joint],
            Parameter::Coulomb(joint) => self.truth.coulomb_nm[joint],
            Parameter::TorqueOffset(_) => 0.0,
            Parameter::Gain(_) => 1.0,
            Parameter::Lead(_) => 0.0,
        }
    }

    /// The error of a parameter, and over its standard error.
    fn error(&self, parameter: Parameter) -> (f64, f64) {
        let error = self.found.values.get(parameter) - self.truth_of(parameter);
        (error, error / self.found.standard_error(parameter).unwrap_or(f64::NAN))
    }

    /// The largest error of any f in standard errors.
    fn worst_f(&self) -> f64 {
        (0..PARAMETERS).map(|index| self.error(Parameter::F(index)).1.abs()).fold(0.0, f64::max)
    }
}

fn judge(robot: &Robot, seed: u64, percent: f64) -> Result<Judged, CommandError> {
    let truth = HiddenRobot::draw(robot, seed);
    let mut recordings = Vec::new();
    for (index, period_s) in PERIODS_S.into_iter().enumerate() {
        let seed = seed.wrapping_mul(PERIODS_S.len() as u64).wrapping_add(index as u64);
        let mut recording = record(robot, &truth, seed, period_s, None)?;
        if percent > 0.0 {
            let deviation_nm = [0, 1].map(|joint| {
                let current = &recording.current_a[joint];
                let square = current.iter().map(|a| a * a).sum::<f64>() / current.len() as f64;
                0.01 * percent * square.sqrt() * robot.joints[joint].torque_constant_nm_per_a
            });
            let noise = TorqueNoise { deviation_nm, correlation_time_s: CORRELATION_TIME_S };
            recording = record(robot, &truth, seed, period_s, Some(noise))?;
        }
        recordings.push(recording);
    }
    let mut guessed = robot.clone();
    for joint in &mut guessed.joints {
        joint.viscous_friction_nm_s_per_rad = joint.viscous_friction_nm_s_per_rad.map(|friction| 1.2 * friction);
        joint.coulomb_friction_nm = joint.coulomb_friction_nm.map(|friction| 0.8 * friction);
    }
    let options = Options { seed, ..Options::default() };
    Ok(Judged { found: identify(&guessed, &recordings, &[], &options, &|_| ())?, truth })
}

/// One recording of the paper's movement.
fn record(
    robot: &Robot,
    truth: &HiddenRobot,
    seed: u64,
    period_s: f64,
    noise: Option<TorqueNoise>,
) -> Result<Recording, CommandError> {
    let configuration = armid::board_setup::configuration(robot)?;
    let mut board = SimulatedBoard::new(robot, truth.clone(), seed);
    if let Some(noise) = noise {
        board = board.with_torque_noise(noise);
    }
    let mut client = Client::connect(Box::new(board))?;
    client.prepare(&configuration, Pose::DefaultsTo([0.0; 2]), false)?;
    let movement = TrajectoryArguments::paper(period_s).prepare(robot)?;
    let run = Run { robot, movement: &movement, mode: Mode::P, seed: Some(seed), path: "bench.csv".into() };
    run.on(&mut client)?.whole()
}

/// All robots at one level of noise.
struct Study {
    percent: f64,
    judged: Vec<Judged>,
}

impl Study {
    fn share(&self, good: impl Fn(&Judged) -> bool) -> f64 {
        self.judged.iter().filter(|judged| good(judged)).count() as f64 / self.judged.len() as f64
    }

    /// How many of all parameters' intervals of ± `width` standard errors hold the truth.
    fn coverage(&self, width: f64) -> f64 {
        let (mut inside, mut all) = (0, 0);
        for judged in &self.judged {
            for &parameter in &judged.found.free {
                all += 1;
                inside += usize::from(judged.error(parameter).1.abs() <= width);
            }
        }
        f64::from(inside as u32) / f64::from(all.max(1) as u32)
    }

    fn rms(&self, of: impl Fn(&Judged) -> f64) -> f64 {
        (self.judged.iter().map(|judged| of(judged).powi(2)).sum::<f64>() / self.judged.len() as f64).sqrt()
    }

    fn largest(&self, of: impl Fn(&Judged) -> f64) -> f64 {
        self.judged.iter().map(|judged| of(judged).abs()).fold(0.0, f64::max)
    }

    /// Each f: largest error, that which is allowed, rms error, rms standard error, rms of their ratio.
    fn rows(&self) -> [[f64; 5]; PARAMETERS] {
        std::array::from_fn(|index| {
            let parameter = Parameter::F(index);
            let allowed = if SMALL.contains(&index) { ALLOWED_SMALL } else { ALLOWED_SHARE * REFERENCE_F[index].abs() };
            [
                self.largest(|judged| judged.error(parameter).0),
                allowed,
                self.rms(|judged| judged.error(parameter).0),
                self.rms(|judged| judged.found.standard_error(parameter).unwrap_or(f64::NAN)),
                self.rms(|judged| judged.error(parameter).1),
            ]
        })
    }

    fn all_near(&self) -> bool {
        self.rows().iter().all(|[largest, allowed, ..]| largest <= allowed)
    }

    fn verdict(&self) -> String {
        format!(
            "With a random torque of {} %, intervals of ±1.96 standard errors hold {:.1} % of all parameters.",
            self.percent,
            100.0 * self.coverage(1.96)
        )
    }

    fn section(&self) -> Section {
        let mut table =
            Table::new(["", "largest error", "allowed", "rms error", "rms stated", "rms of error over stated"]);
        for (index, [largest, allowed, error, stated, ratio]) in self.rows().into_iter().enumerate() {
            let errors = [largest, allowed, error, stated].map(|error| Cell::fixed(error, 6));
            let name = Cell::from(format!("f{}", index + 1));
            table = table.row([name].into_iter().chain(errors).chain([Cell::fixed(ratio, 2)]));
        }
        let sentences = [
            format!(
                "Every f within what is allowed: {}; worst f within 3 standard errors: {:.1} % of robots.",
                if self.all_near() { "yes" } else { "no" },
                100.0 * self.share(|judged| judged.worst_f() <= 3.0)
            ),
            format!(
                "Intervals of ±1.96 standard errors hold {:.1} % of all parameters, ±3 hold {:.1} %.",
                100.0 * self.coverage(1.96),
                100.0 * self.coverage(3.0)
            ),
            format!(
                "Lack of fit reported: {:.1} % of robots; something not identifiable: {:.1} %.",
                100.0 * self.share(|judged| judged.found.lack_of_fit),
                100.0 * self.share(|judged| !judged.found.not_identifiable.is_empty())
            ),
        ];
        let (robots, percent) = (self.judged.len(), self.percent);
        Section::new(format!("{robots} robots, random torque {percent} % of each motor's rms torque"))
            .table(table)
            .list(sentences)
            .pictures(vec![self.errors(), self.coverages()])
    }

    /// Errors of f beside the standard errors stated.
    fn errors(&self) -> Picture {
        let rows = self.rows();
        let of = |column: usize, to: usize| {
            let interval = |row: &[f64; 5]| Interval { low: row[column], value: row[column], high: row[to] };
            rows.iter().map(|row| Some(interval(row))).collect::<Vec<_>>()
        };
        let sources = vec![
            ("error, rms and up to the largest".to_string(), Ink::Measured, of(2, 0)),
            ("standard error stated, rms".to_string(), Ink::Simulated, of(3, 3)),
        ];
        let names = (1..=PARAMETERS).map(|f| format!("f{f}")).collect();
        let content = Content::Intervals(Intervals { names, sources, logarithmic: true });
        Picture::of("Errors of f, kg m² and kg m", ["", "error"], content)
    }

    /// Parameters within so many standard errors, beside those of a normal distribution.
    fn coverages(&self) -> Picture {
        const STEP: f64 = 0.05;
        let widths = || (0..=80).map(|step| STEP * f64::from(step));
        let found = widths().map(|width| (width, 100.0 * self.coverage(width))).collect();
        let mut within = 0.0;
        let normal = widths().map(|width| {
            let point = (width, within);
            // The density in the middle of the step: exact to 1e-4 per cent.
            let middle = width + 0.5 * STEP;
            within += 100.0 * STEP * (2.0 / std::f64::consts::PI).sqrt() * (-0.5 * middle * middle).exp();
            point
        });
        let normal = normal.collect();
        let lines =
            vec![Line::new("of a normal distribution", Ink::Bound, normal), Line::new("found", Ink::Measured, found)];
        Picture::lines("Parameters within their intervals", ["± standard errors", "%"], lines)
    }

    fn to_json(&self) -> Value {
        let rows = self.rows();
        let column = |k: usize| rows.iter().map(|row| row[k]).collect::<Vec<f64>>();
        json!({
            "torque_noise_percent": self.percent,
            "largest_error_f": column(0),
            "allowed_error_f": column(1),
            "rms_error_f": column(2),
            "rms_standard_error_f": column(3),
            "rms_error_over_standard_error_f": column(4),
            "mean_error_over_standard_error_f": (0..PARAMETERS).map(|index| {
                let ratios = self.judged.iter().map(|judged| judged.error(Parameter::F(index)).1);
                ratios.sum::<f64>() / self.judged.len() as f64
            }).collect::<Vec<f64>>(),
            "all_f_within_allowed": self.all_near(),
            "share_worst_f_within_3_standard_errors": self.share(|judged| judged.worst_f() <= 3.0),
            "coverage_95": self.coverage(1.96),
            "coverage_3_standard_errors": self.coverage(3.0),
            "share_lack_of_fit": self.share(|judged| judged.found.lack_of_fit),
        })
    }
}
