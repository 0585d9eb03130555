//! `armid bench load`: loads taken up by arms whose model is wrong, found by the board.
//!
//! Every arm is drawn around the reference robot; its model has every f off by up to 3 % and all friction by up to 5 %, and
//! says so in its standard errors. It takes up a load at rest, before the paper's movement, and another time in the middle of
//! it. The rival is recursive least squares on the same rows: one unknown, torque against what the model and the reference's
//! motion ask for.

use armid::client::{Client, MovementPlan, Pose};
use armid::compensation::board_model;
use armid::hidden_robot::HiddenRobot;
use armid::link::{LoadChange, SimulatedBoard};
use armid::load::{self, Listener, Told};
use armid::model::Model;
use armid::random::Random;
use armid::report::{Cell, Content, Ink, Line, Picture, Section, Table};
use armid::robot::{Gripper, Robot};
use armid::trajectory_file;
use clap::Args;
use rayon::prelude::*;
use serde_json::{Value, json};
use shared::arm::Arm;
use shared::load::{LoadEstimate, LoadNews, LoadSettings};
use shared::protocol::{ControlLaw, CurrentScale, Sample};
use shared::trajectory::Trajectory;

use super::super::{CommandError, page, progress};
use super::Measured;

/// Period T of the movement, s.
const PERIOD_S: f64 = 3.65;
/// Period of the movements without change, s: the longest that is recorded.
const QUIET_PERIOD_S: f64 = 7.3;
/// How far the model's f and friction are off, at most.
const F_SHARE: f64 = 0.03;
const FRICTION_SHARE: f64 = 0.05;
/// When a load is taken up in the middle of the movement, s.
const PICKED_BETWEEN_S: [f64; 2] = [0.9, 2.2];
const SETTLE_NS: u64 = 500_000_000;

const EXAMPLES: &str = "Example:
  armid bench load --picks 200";

/// Arguments of `bench load`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Load {
    /// How many arms, each with a load taken up at rest and another in motion
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    picks: u64,
    /// How long nothing changes, hours of recorded motion
    #[arg(long, value_name = "HOURS", default_value_t = 1.0)]
    quiet_hours: f64,
    /// Have the empty arm show its model's errors first; only loads taken up in motion are found then
    #[arg(long)]
    differential: bool,
    /// Seed of the first arm; the others take the ones after it
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

impl Load {
    pub fn measure(&self) -> Result<Measured, CommandError> {
        if !(0.0..=1000.0).contains(&self.quiet_hours) {
            return Err(CommandError::Usage(format!("--quiet-hours {} is not from 0 to 1000", self.quiet_hours)));
        }
        let robot = Robot::paper();
        let bar = progress::bar("bench load: picks", 2 * self.picks);
        let seeds: Vec<u64> = (self.seed..self.seed + self.picks).collect();
        let both = seeds
            .par_iter()
            .map(|&seed| {
                let mut random = Random::new(seed, 7);
                let mass_kg = random.between(0.0, Gripper::REFERENCE.maximum_load_kg);
                let at_s = random.between(PICKED_BETWEEN_S[0], PICKED_BETWEEN_S[1]);
                let at_rest = if self.differential { None } else { Some(pick(&robot, seed, mass_kg, 0.0, false)?) };
                bar.inc(1);
                let moving = pick(&robot, seed, mass_kg, at_s, self.differential)?;
                bar.inc(1);
                Ok((at_rest, moving))
            })
            .collect::<Result<Vec<(Option<Pick>, Pick)>, CommandError>>()?;
        bar.finish_and_clear();
        let (at_rest, moving): (Vec<Option<Pick>>, Vec<Pick>) = both.into_iter().unzip();
        let at_rest: Vec<Pick> = at_rest.into_iter().flatten().collect();

        let movements = (self.quiet_hours * 3600.0 / QUIET_PERIOD_S).ceil() as u64;
        let bar = progress::bar("bench load: no change", movements);
        let false_triggers = (0..movements.div_ceil(QUIET_MOVEMENTS))
            .into_par_iter()
            .map(|arm| {
                let count = QUIET_MOVEMENTS.min(movements - arm * QUIET_MOVEMENTS);
                let triggers = quiet(&robot, self.seed + 100_000 + arm, count, self.differential);
                bar.inc(count);
                triggers
            })
            .collect::<Result<Vec<usize>, CommandError>>()?
            .into_iter()
            .sum::<usize>();
        bar.finish_and_clear();
        let quiet_s = movements as f64 * QUIET_PERIOD_S;
        let studies: Vec<(&str, &[Pick], Study)> = [("at rest", &at_rest), ("in motion", &moving)]
            .into_iter()
            .filter(|(_, picks)| !picks.is_empty())
            .map(|(name, picks)| (name, picks.as_slice(), Study::of(picks)))
            .collect();
        let json = |wanted: &str| studies.iter().find(|(name, ..)| *name == wanted).map(|(.., study)| study.to_json());
        let verdict = studies.iter().map(|(name, _, study)| {
            format!("Taken up {name}: mass error {:.3} kg rms, stated {:.3}.", study.rms_kg, study.stated_kg)
        });
        let quiet = format!("No change: {false_triggers} false triggers in {quiet_s:.0} s of motion.");
        let mut sections: Vec<Section> =
            studies.iter().map(|(name, picks, study)| study.section(name).pictures(pictures(picks))).collect();
        sections.push(Section::new("Without a change").text(&quiet));
        Ok(Measured {
            title: "Loads taken up by arms whose model is wrong".into(),
            verdict: verdict.chain([quiet]).collect::<Vec<_>>().join(" "),
            sections,
            json: json!({
                "seed": self.seed,
                "picks": self.picks,
                "differential": self.differential,
                "at_rest": json("at rest"),
                "in_motion": json("in motion"),
                "quiet_s": quiet_s,
                "false_triggers": false_triggers,
            }),
            provenance: page::provenance()
                .robot(&robot)
                .fact("loads", format!("0 to {} kg", Gripper::REFERENCE.maximum_load_kg))
                .fact(
                    "model off by up to",
                    format!("{:.0} % of f, {:.0} % of friction", 100.0 * F_SHARE, 100.0 * FRICTION_SHARE),
                )
                .fact("seeds", super::seeds(self.seed, self.picks)),
        })
    }
}

/// What was found against what was carried, and how far off the masses are.
fn pictures(picks: &[Pick]) -> Vec<Picture> {
    let found = |pick: &Pick| Some((pick.mass_kg, f64::from(pick.found.as_ref()?.mass_kg)));
    let rival = |pick: &Pick| Some((pick.mass_kg, pick.rival_kg?));
    let points = |of: &dyn Fn(&Pick) -> Option<(f64, f64)>| picks.iter().filter_map(of).collect::<Vec<_>>();
    let own = Line::new("armid", Ink::Measured, points(&found));
    let rival = Line::new("recursive least squares", Ink::Simulated, points(&rival));
    let error = |line: &Line| {
        let points = line.points.iter().map(|&(carried, found)| (carried, found - carried)).collect();
        Line::new(line.name.as_str(), line.ink, points)
    };
    let ends = [0.0, Gripper::REFERENCE.maximum_load_kg];
    let exact = |of: fn(f64) -> f64| vec![Line::new("exact", Ink::Bound, ends.map(|kg| (kg, of(kg))).to_vec())];
    let errors = Content::Points(vec![error(&rival), error(&own)], exact(|_| 0.0));
    vec![
        Picture::of("Mass found", ["carried, kg", "found, kg"], Content::Points(vec![rival, own], exact(|kg| kg))),
        Picture::of("Its error", ["carried, kg", "found less carried, kg"], errors),
    ]
}

/// Movements of one arm without change.
const QUIET_MOVEMENTS: u64 = 10;

/// A model as wrong as they are here, and its statement of that.
fn wrong_model(hidden: &HiddenRobot, seed: u64) -> Model {
    let mut random = Random::new(seed, 8);
    let mut off = |value: f64, share: f64| value * random.between(1.0 - share, 1.0 + share);
    let truth = hidden.to_model(toml::Table::new());
    // Standard deviation of a uniform distribution.
    let error = |value: &f64, share: f64| share / 3.0_f64.sqrt() * value.abs();
    let f = truth.f.map(|value| off(value, F_SHARE));
    let mut friction =
        |values: &[f64]| -> Vec<f64> { values.iter().map(|&value| off(value, FRICTION_SHARE)).collect() };
    let viscous = friction(&truth.viscous_nm_s_per_rad);
    let coulomb = friction(&truth.coulomb_nm);
    Model {
        f,
        f_standard_error: Some(f.map(|value| error(&value, F_SHARE))),
        viscous_standard_error: Some(viscous.iter().map(|value| error(value, FRICTION_SHARE)).collect()),
        viscous_nm_s_per_rad: viscous,
        coulomb_standard_error: Some(coulomb.iter().map(|value| error(value, FRICTION_SHARE)).collect()),
        coulomb_nm: coulomb,
        ..truth
    }
}

/// A board with a wrong model that identifies loads.
fn board(
    robot: &Robot,
    seed: u64,
    from_start_kg: f64,
    changes: &[LoadChange],
    differential: bool,
) -> Result<(Client, Model), CommandError> {
    let hidden = HiddenRobot::draw(robot, seed);
    let model = wrong_model(&hidden, seed);
    let board = SimulatedBoard::new(robot, hidden, seed).with_load(Gripper::REFERENCE.holding(from_start_kg), changes);
    let mut client = Client::connect_from(Box::new(board), 1)?;
    client.prepare(&armid::board_setup::configuration(robot)?, Pose::DefaultsTo([0.0; 2]), false)?;
    client.upload(&board_model(robot, &model)?)?;
    let settings = load::settings(robot, &model, &Gripper::REFERENCE);
    client.identify_load(&LoadSettings { differential, ..settings })?;
    Ok((client, model))
}

/// One movement under computed torque: its rows, and what was told, in rows from the start.
fn movement(
    client: &mut Client,
    robot: &Robot,
    trajectory: &Trajectory,
) -> Result<(Vec<Sample>, Vec<Told>), CommandError> {
    client.load_trajectory(trajectory)?;
    let mut show = |_: &Told| {};
    let mut listener = Listener::new(robot, &mut show);
    let plan = MovementPlan { law: ControlLaw::ComputedTorque, settle_ns: SETTLE_NS };
    let movement = client.run_watched(&plan, &mut |_| {}, &mut listener)?;
    if let Some(reason) = movement.partial {
        return Err(CommandError::Failed(format!("a movement did not come to its end: {reason}")));
    }
    let start_s = listener.told.first().map_or(0.0, |told| told.at_s);
    let told = listener.told.into_iter().map(|told| Told { at_s: told.at_s - start_s, ..told }).collect();
    Ok((movement.samples, told))
}

fn paper(period_s: f64) -> Result<Trajectory, CommandError> {
    trajectory_file::paper(period_s).ok_or_else(|| CommandError::Failed("the paper's movement".into()))
}

/// How often a change was seen where there was none.
fn quiet(robot: &Robot, seed: u64, movements: u64, differential: bool) -> Result<usize, CommandError> {
    let mass_kg =
        if differential { 0.0 } else { Random::new(seed, 7).between(0.0, Gripper::REFERENCE.maximum_load_kg) };
    let (mut client, _) = board(robot, seed, mass_kg, &[], differential)?;
    let trajectory = paper(QUIET_PERIOD_S)?;
    let mut triggers = 0;
    for _ in 0..movements {
        let (_, told) = movement(&mut client, robot, &trajectory)?;
        triggers += told.iter().filter(|told| matches!(told.news, LoadNews::Changed { .. })).count();
    }
    Ok(triggers)
}

/// What came of one load taken up.
struct Pick {
    mass_kg: f64,
    /// What the board found, if it noticed.
    found: Option<LoadEstimate>,
    /// Mass that recursive least squares finds from the same rows, kg.
    rival_kg: Option<f64>,
    /// From the pick (or the movement's start) to the change of model, s.
    acted_after_s: Option<f64>,
    /// From the last row to the change of model, s.
    identified_in_s: Option<f64>,
    /// Largest recorded errors of both joints before, during and after, counts.
    largest_error_counts: [f64; 3],
}

fn pick(robot: &Robot, seed: u64, mass_kg: f64, at_s: f64, differential: bool) -> Result<Pick, CommandError> {
    let moving = at_s > 0.0;
    let change = [LoadChange { at_s, load: Gripper::REFERENCE.holding(mass_kg) }];
    let (from_start_kg, changes): (f64, &[LoadChange]) = if moving { (0.0, &change) } else { (mass_kg, &[]) };
    let (mut client, model) = board(robot, seed, from_start_kg, changes, differential)?;
    let trajectory = paper(PERIOD_S)?;
    let (samples, told) = movement(&mut client, robot, &trajectory)?;
    let after = |news: fn(&LoadNews) -> bool, from_s: f64| {
        told.iter().find(|told| told.at_s >= from_s && news(&told.news)).copied()
    };
    let noticed =
        if moving { after(|news| matches!(news, LoadNews::Changed { .. }), at_s) } else { told.first().copied() };
    let from_s = noticed.map_or(f64::MAX, |told| told.at_s);
    let found = after(|news| matches!(news, LoadNews::Found(_)), from_s);
    let searching = after(|news| matches!(news, LoadNews::Searching), from_s);
    let collecting = after(|news| matches!(news, LoadNews::Collecting), from_s);
    let row = |at_s: f64| ((at_s / robot.record_period_s) as usize).min(samples.len());
    let largest = |from_s: f64, to_s: f64| {
        let rows = samples.get(row(from_s)..row(to_s)).unwrap_or(&[]);
        rows.iter().flat_map(|row| row.error_counts).map(|error| f64::from(error.abs())).fold(0.0, f64::max)
    };
    let acted_s = found.map_or(f64::MAX, |told| told.at_s + 0.05);
    let rival_kg = collecting.zip(searching).map(|(collecting, searching)| {
        let rows = samples.get(row(collecting.at_s)..row(searching.at_s)).unwrap_or(&[]);
        recursive_least_squares(robot, &model, &trajectory, rows)
    });
    Ok(Pick {
        mass_kg,
        found: found.and_then(|told| match told.news {
            LoadNews::Found(found) => Some(found),
            _ => None,
        }),
        rival_kg,
        acted_after_s: found.map(|found| found.at_s - at_s),
        identified_in_s: found.zip(searching).map(|(found, searching)| found.at_s - searching.at_s),
        largest_error_counts: [largest(at_s - 0.3, at_s), largest(at_s, acted_s), largest(acted_s, PERIOD_S)],
    })
}

/// The rival: one unknown, updated row by row. The arm is taken to move as its reference, which it does within a few counts.
fn recursive_least_squares(robot: &Robot, model: &Model, trajectory: &Trajectory, rows: &[Sample]) -> f64 {
    let arm = model.arm(robot);
    let per_kg = Arm { f: Gripper::REFERENCE.holding(1.0).delta_f(robot.upper_arm_m), ..arm };
    let (mut mass_kg, mut variance) = (0.5 * Gripper::REFERENCE.maximum_load_kg, 1.0e3);
    let mut previous_code: Option<[u16; 2]> = None;
    for sample in rows {
        // The command in force between this row and the next, and the motion half-way.
        let time_s = (f64::from(sample.index) + 0.5) * robot.record_period_s;
        let moving = trajectory.reference::<f64>((1e9 * time_s) as u64);
        let (position, velocity, acceleration) =
            (moving.position_rad, moving.velocity_rad_s, moving.acceleration_rad_s2);
        let needed = arm.inverse_dynamics_nm(position, velocity, acceleration);
        let regressor = per_kg.inverse_dynamics_nm(position, velocity, acceleration);
        let late = robot.command_delay_s / robot.record_period_s;
        let before = previous_code.unwrap_or(sample.command_code);
        previous_code = Some(sample.command_code);
        for joint in 0..2 {
            let drive = robot.joints[joint].drive();
            let scale = CurrentScale::symmetric(robot.joints[joint].current_full_scale_a);
            let current_a =
                late * scale.command_a(before[joint]) + (1.0 - late) * scale.command_a(sample.command_code[joint]);
            let motor_speed = drive.gear_ratio * velocity[joint];
            let friction =
                model.viscous_nm_s_per_rad[joint] * motor_speed + model.coulomb_nm[joint] * motor_speed.signum();
            let torque = drive.gear_ratio * (drive.torque_constant_nm_per_a * current_a - friction);
            let innovation = torque - needed[joint] - regressor[joint] * mass_kg;
            let gain = variance * regressor[joint] / (1.0 + regressor[joint] * variance * regressor[joint]);
            mass_kg += gain * innovation;
            variance -= gain * regressor[joint] * variance;
        }
    }
    mass_kg
}

/// Many of them.
struct Study {
    picks: usize,
    found: usize,
    rms_kg: f64,
    largest_kg: f64,
    rival_rms_kg: f64,
    stated_kg: f64,
    /// Share of masses within one and within two stated standard errors.
    covered: [f64; 2],
    /// Largest mass that was not noticed, kg.
    largest_missed_kg: f64,
    /// Median and largest.
    acted_after_s: [f64; 2],
    identified_in_s: [f64; 2],
    /// Median and largest of the largest errors before, during and after.
    error_counts: [[f64; 2]; 3],
}

impl Study {
    fn of(picks: &[Pick]) -> Self {
        let found: Vec<(&Pick, &LoadEstimate)> =
            picks.iter().filter_map(|pick| pick.found.as_ref().map(|found| (pick, found))).collect();
        let count = found.len().max(1) as f64;
        let errors: Vec<f64> =
            found.iter().map(|(pick, found)| (f64::from(found.mass_kg) - pick.mass_kg).abs()).collect();
        let rms = |values: &[f64]| {
            (values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64).sqrt()
        };
        let rival: Vec<f64> =
            found.iter().filter_map(|(pick, _)| pick.rival_kg.map(|rival_kg| rival_kg - pick.mass_kg)).collect();
        let covered = |by: f64| {
            let within = errors
                .iter()
                .zip(&found)
                .filter(|(error, (_, found))| **error <= by * f64::from(found.standard_error_kg));
            within.count() as f64 / count
        };
        let missed = picks.iter().filter(|pick| pick.found.is_none()).map(|pick| pick.mass_kg);
        let of = |value: fn(&Pick) -> Option<f64>| median_and_largest(picks.iter().filter_map(value).collect());
        Self {
            picks: picks.len(),
            found: found.len(),
            rms_kg: rms(&errors),
            largest_kg: errors.iter().copied().fold(0.0, f64::max),
            rival_rms_kg: rms(&rival),
            stated_kg: found.iter().map(|(_, found)| f64::from(found.standard_error_kg)).sum::<f64>() / count,
            covered: [covered(1.0), covered(2.0)],
            largest_missed_kg: missed.fold(0.0, f64::max),
            acted_after_s: of(|pick| pick.acted_after_s),
            identified_in_s: of(|pick| pick.identified_in_s),
            error_counts: [
                of(|pick| Some(pick.largest_error_counts[0])),
                of(|pick| Some(pick.largest_error_counts[1])),
                of(|pick| Some(pick.largest_error_counts[2])),
            ],
        }
    }

    fn to_json(&self) -> Value {
        json!({
            "picks": self.picks,
            "found": self.found,
            "largest_missed_kg": self.largest_missed_kg,
            "rms_error_kg": self.rms_kg,
            "largest_error_kg": self.largest_kg,
            "mean_standard_error_kg": self.stated_kg,
            "within_one_standard_error": self.covered[0],
            "within_two_standard_errors": self.covered[1],
            "recursive_least_squares_rms_error_kg": self.rival_rms_kg,
            "acted_after_s": {"median": self.acted_after_s[0], "largest": self.acted_after_s[1]},
            "identify_s": {"median": self.identified_in_s[0], "largest": self.identified_in_s[1]},
            "largest_error_counts": {
                "before": self.error_counts[0], "during": self.error_counts[1], "after": self.error_counts[2],
            },
        })
    }

    fn section(&self, name: &str) -> Section {
        let number = |value: f64, digits: usize| [Cell::fixed(value, digits), Cell::Missing];
        let of = |[median, largest]: [f64; 2], digits: usize| [median, largest].map(|value| Cell::fixed(value, digits));
        let rows = [
            ("found", number(self.found as f64, 0)),
            ("largest not noticed, kg", number(self.largest_missed_kg, 2)),
            ("mass error, kg: rms, largest", of([self.rms_kg, self.largest_kg], 3)),
            ("stated error, kg, mean", number(self.stated_kg, 3)),
            ("within one and two stated errors, %", of(self.covered.map(|share| 100.0 * share), 0)),
            ("recursive least squares on the same rows, kg rms", number(self.rival_rms_kg, 3)),
            ("in use after, s: median, largest", of(self.acted_after_s, 3)),
            ("of that after the last row, s: median, largest", of(self.identified_in_s, 3)),
            ("largest error before, counts: median, largest", of(self.error_counts[0], 0)),
            ("largest error during, counts: median, largest", of(self.error_counts[1], 0)),
            ("largest error after, counts: median, largest", of(self.error_counts[2], 0)),
        ];
        let mut table = Table::new(["", "", ""]);
        for (name, values) in rows {
            table = table.row([Cell::from(name)].into_iter().chain(values));
        }
        Section::new(format!("{} taken up {name}", self.picks)).table(table)
    }
}

fn median_and_largest(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    [values.get(values.len() / 2).copied().unwrap_or(0.0), values.last().copied().unwrap_or(0.0)]
}
