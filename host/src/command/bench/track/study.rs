//! What limits tracking, one thing at a time beside the exact model; and bandwidths, by tracking and by margin.

use armid::hidden_robot::HiddenRobot;
use armid::margins::{ArmLoop, Margins};
use armid::random::Random;
use armid::report::{Cell, Ink, Line, Picture, Section, Table};
use armid::robot::Robot;
use armid::tracking::{Followed, TrackingLoop};
use rayon::prelude::*;
use serde_json::{Value, json};
use shared::control::ComputedTorqueSettings;
use shared::effects::{Effects, JointEffects};
use shared::trajectory::Trajectory;

use crate::command::progress;

/// Movements of those designed that bandwidths and limits are judged on.
const MOVEMENTS: usize = 4;

/// The bandwidths compared, rad/s.
const BANDWIDTHS_RAD_S: [f64; 5] = [100.0, 150.0, 200.0, 250.0, 300.0];
const OBSERVERS_RAD_S: [f64; 4] = [400.0, 600.0, 800.0, 1200.0];

/// Widths over which friction changes sign, at the motor, rad/s.
const SWITCHES_RAD_S: [f64; 4] = [0.1, 0.25, 0.5, 1.0];

/// Frequency at which motor and link of joint 3 swing against each other on the flexible arm, Hz, at q3 = 0, and its
/// damping ratio: within the 27 to 32 Hz that the paper saw.
const FLEXIBLE_HZ: f64 = 30.0;
const FLEXIBLE_DAMPING: f64 = 0.01;

/// A change beside the exact model.
type Change = fn(TrackingLoop, &mut Random) -> TrackingLoop;

/// Changes by name. The first is none.
const CHANGES: &[(&str, Change)] = &[
    ("exact model", |exact, _| exact),
    ("encoders do not round", |exact, _| TrackingLoop { encoders_round: false, ..exact }),
    ("converters do not round", |exact, _| TrackingLoop { converters_round: false, ..exact }),
    ("no delay of the command", |exact, _| TrackingLoop { delay_s: 0.0, believed_delay_s: 0.0, ..exact }),
    ("60 µs of delay nobody knows of", |exact, _| TrackingLoop { delay_s: exact.delay_s + 60e-6, ..exact }),
    ("amplifiers lag by 64 µs", |exact, _| {
        with_effects(exact, JointEffects { current_lag_s: 64e-6, ..JointEffects::OFF })
    }),
    ("loop of 0.35 ms", |exact, _| TrackingLoop { period_s: 0.00035, ..exact }),
    ("loop of 0.1 ms", |exact, _| TrackingLoop { period_s: 0.0001, ..exact }),
    ("every f up to 1 % off", |exact, random| exact.with_wrong_f(0.01, random)),
    ("every f up to 5 % off", |exact, random| exact.with_wrong_f(0.05, random)),
    ("Coulomb friction up to 5 % off", |exact, random| exact.with_wrong_friction(0.05, 0.0, random)),
    ("viscous friction up to 5 % off", |exact, random| exact.with_wrong_friction(0.0, 0.05, random)),
    ("f and friction up to 5 % off", |exact, random| {
        exact.with_wrong_f(0.05, random).with_wrong_friction(0.05, 0.05, random)
    }),
    ("the same, encoders do not round", |exact, random| {
        let wrong = exact.with_wrong_f(0.05, random).with_wrong_friction(0.05, 0.05, random);
        TrackingLoop { encoders_round: false, ..wrong }
    }),
];

fn with_effects(exact: TrackingLoop, joint: JointEffects<f64>) -> TrackingLoop {
    TrackingLoop { effects: Effects { joints: [joint; 2], ..Effects::OFF }, ..exact }
}

/// All joints, movements and arms together.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    followed: f64,
    max_counts: f64,
    square_counts2: f64,
    within: f64,
    worst_within: f64,
    noise_a: f64,
}

impl Sum {
    fn of(followed: &[[Followed; 2]]) -> Self {
        let mut sum = Self { worst_within: 1.0, ..Self::default() };
        for one in followed.iter().flatten() {
            sum.followed += 1.0;
            sum.max_counts = sum.max_counts.max(one.max_counts);
            sum.square_counts2 += one.rms_counts * one.rms_counts;
            sum.within += one.within_one_count;
            sum.worst_within = sum.worst_within.min(one.within_one_count);
            sum.noise_a += one.command_noise_a;
        }
        sum
    }

    fn rms_counts(&self) -> f64 {
        (self.square_counts2 / self.followed).sqrt()
    }

    fn within_percent(&self) -> f64 {
        100.0 * self.within / self.followed
    }

    fn command_noise_a(&self) -> f64 {
        self.noise_a / self.followed
    }

    fn to_json(self) -> Value {
        json!({
            "max_abs_error_counts": self.max_counts,
            "rms_error_counts": self.rms_counts(),
            "within_one_count": self.within_percent(),
            "worst_within_one_count": 100.0 * self.worst_within,
            "command_noise_a": self.command_noise_a(),
        })
    }
}

/// One combination of bandwidths.
struct Choice {
    settings: ComputedTorqueSettings<f64>,
    exact: Sum,
    wrong: Sum,
    rigid: Margins,
    flexible: Margins,
}

pub(super) struct Study {
    limits: Vec<(&'static str, Sum)>,
    choices: Vec<Choice>,
}

impl Study {
    pub(super) fn new(robot: &Robot, seeds: &[u64], designed: &[Trajectory]) -> Self {
        let mut movements: Vec<Trajectory> = armid::trajectory_file::paper(3.65).into_iter().collect();
        movements.extend(designed.iter().take(MOVEMENTS).cloned());
        let wanted = wanted(&robot.computed_torque);
        let bar = progress::bar("bench track: study", (CHANGES.len() + wanted.len()) as u64);
        // Every change and choice meets the same arms, movements and errors of models.
        let sum = |change: &(dyn Fn(TrackingLoop, &mut Random) -> TrackingLoop + Sync)| {
            let followed: Vec<[Followed; 2]> = seeds
                .par_iter()
                .flat_map(|&seed| {
                    let truth = HiddenRobot::draw(robot, seed).plant(robot);
                    let mut random = Random::new(seed, 21);
                    let loops: Vec<TrackingLoop> =
                        movements.iter().map(|_| change(TrackingLoop::exact(robot, truth), &mut random)).collect();
                    loops
                        .into_par_iter()
                        .zip(&movements)
                        .map(|(one, movement)| one.follow(movement))
                        .collect::<Vec<_>>()
                })
                .collect();
            Sum::of(&followed)
        };
        let limits = CHANGES
            .iter()
            .map(|(name, change)| {
                let sum = sum(change);
                bar.inc(1);
                (*name, sum)
            })
            .collect();
        let rigid = arm_loop(robot, false);
        let flexible = arm_loop(robot, true);
        let choices = wanted
            .into_iter()
            .map(|settings| {
                let choice = Choice {
                    settings,
                    exact: sum(&|exact, _| TrackingLoop { settings, ..exact }),
                    wrong: sum(&|exact, random| TrackingLoop {
                        settings,
                        ..exact.with_wrong_f(0.05, random).with_wrong_friction(0.05, 0.05, random)
                    }),
                    rigid: rigid.margins(&settings),
                    flexible: flexible.margins(&settings),
                };
                bar.inc(1);
                choice
            })
            .collect();
        bar.finish_and_clear();
        Self { limits, choices }
    }

    pub(super) fn limits(&self) -> Section {
        let mut table = Table::new([
            "change",
            "largest error",
            "rms error",
            "within ±1, %",
            "the worst movement, %",
            "command noise, A",
        ]);
        for (name, sum) in &self.limits {
            table = table.row([
                Cell::from(*name),
                Cell::fixed(sum.max_counts, 2),
                Cell::fixed(sum.rms_counts(), 3),
                Cell::fixed(sum.within_percent(), 3),
                Cell::fixed(100.0 * sum.worst_within, 2),
                Cell::fixed(sum.command_noise_a(), 3),
            ]);
        }
        Section::new("What limits it")
            .text("One change beside the exact model; true errors of both joints, in counts.")
            .table(table)
    }

    pub(super) fn bandwidths(&self) -> Section {
        let mut table = Table::new([
            "ω, rad/s",
            "observer, rad/s",
            "switch, rad/s",
            "exact: largest",
            "exact: rms",
            "exact: noise, A",
            "wrong: largest",
            "wrong: rms",
            "wrong: worst, %",
            "rigid",
            "flexible",
        ]);
        for choice in &self.choices {
            let margin = |margins: &Margins| {
                if margins.spectral_radius >= 1.0 {
                    return Cell::from("unstable");
                }
                let (gain, phase_deg) = worse(margins);
                Cell::from(format!("{gain:.2} / {phase_deg:.0}°"))
            };
            let (exact, wrong) = (&choice.exact, &choice.wrong);
            table = table.row([
                Cell::fixed(choice.settings.bandwidth_rad_s, 0),
                Cell::fixed(choice.settings.observer_bandwidth_rad_s, 0),
                Cell::fixed(choice.settings.friction_switch_motor_rad_s, 2),
                Cell::fixed(exact.max_counts, 2),
                Cell::fixed(exact.rms_counts(), 3),
                Cell::fixed(exact.command_noise_a(), 3),
                Cell::fixed(wrong.max_counts, 2),
                Cell::fixed(wrong.rms_counts(), 3),
                Cell::fixed(100.0 * wrong.worst_within, 2),
                margin(&choice.rigid),
                margin(&choice.flexible),
            ]);
        }
        Section::new("Bandwidths")
            .text(format!(
                "Errors in counts with the exact model, and with f and friction up to 5 % off; gain and phase margin of the \
                 worse joint, rigid and with a shaft of joint 3 that swings at {FLEXIBLE_HZ} Hz."
            ))
            .table(table)
            .pictures(vec![
                self.over_bandwidth("f and friction up to 5 % off", "error, counts rms", |one| one.wrong.rms_counts()),
                self.over_bandwidth("Gain margin, rigid arm", "gain margin", |one| worse(&one.rigid).0),
            ])
    }

    /// Something over the bandwidth, a line an observer.
    fn over_bandwidth(&self, title: &str, axis: &str, value: fn(&Choice) -> f64) -> Picture {
        let line = |(place, observer): (usize, f64)| {
            let of = self.choices.iter().filter(|choice| choice.settings.observer_bandwidth_rad_s == observer);
            // The widths of switching are compared at one pair of bandwidths only.
            let first = self.choices.first().map(|choice| choice.settings.friction_switch_motor_rad_s);
            let of = of.filter(|choice| Some(choice.settings.friction_switch_motor_rad_s) == first);
            let points = of.map(|choice| (choice.settings.bandwidth_rad_s, value(choice))).collect();
            Line::new(format!("observer {observer} rad/s"), Ink::Nth(place), points)
        };
        let lines = OBSERVERS_RAD_S.into_iter().enumerate().map(line).collect();
        Picture::lines(title, ["ω, rad/s", axis], lines)
    }

    pub(super) fn limits_to_json(&self) -> Vec<Value> {
        let object = |(name, sum): &(&str, Sum)| {
            let mut object = sum.to_json();
            object["change"] = json!(name);
            object
        };
        self.limits.iter().map(object).collect()
    }

    pub(super) fn settings_to_json(&self) -> Vec<Value> {
        let object = |choice: &Choice| {
            json!({
                "bandwidth_rad_s": choice.settings.bandwidth_rad_s,
                "observer_bandwidth_rad_s": choice.settings.observer_bandwidth_rad_s,
                "friction_switch_motor_rad_s": choice.settings.friction_switch_motor_rad_s,
                "exact": choice.exact.to_json(),
                "wrong": choice.wrong.to_json(),
                "rigid_gain_and_phase_margin": worse(&choice.rigid),
                "flexible_gain_and_phase_margin": worse(&choice.flexible),
            })
        };
        self.choices.iter().map(object).collect()
    }
}

/// Every pair of bandwidths, and every width of switching with the own ones.
fn wanted(own: &ComputedTorqueSettings<f64>) -> Vec<ComputedTorqueSettings<f64>> {
    let pairs = BANDWIDTHS_RAD_S.into_iter().flat_map(|bandwidth_rad_s| {
        OBSERVERS_RAD_S.map(|observer_bandwidth_rad_s| ComputedTorqueSettings {
            bandwidth_rad_s,
            observer_bandwidth_rad_s,
            ..*own
        })
    });
    let switches = SWITCHES_RAD_S
        .map(|friction_switch_motor_rad_s| ComputedTorqueSettings { friction_switch_motor_rad_s, ..*own });
    pairs.chain(switches.into_iter().filter(|settings| settings != own)).collect()
}

/// Gain and phase margin of the worse joint.
fn worse(margins: &Margins) -> (f64, f64) {
    let least = |value: fn(&armid::margins::JointMargins) -> f64| {
        margins.joints.iter().map(value).fold(f64::INFINITY, f64::min)
    };
    (least(|joint| joint.gain_margin), least(|joint| joint.phase_margin_deg))
}

/// The loop of the reference robot, rigid or with a shaft.
fn arm_loop(robot: &Robot, flexible: bool) -> ArmLoop {
    let viscous = [0, 1].map(|joint: usize| robot.joints[joint].drive().viscous_friction_nm_s_per_rad);
    let mut arm = ArmLoop::rigid(robot, shared::arm::REFERENCE_F, viscous);
    if flexible {
        let motor = arm.motor_inertia_kg_m2[1];
        let link = arm.f[0] - motor;
        let omega = std::f64::consts::TAU * FLEXIBLE_HZ;
        arm.compliance_rad_per_nm[1] = (motor + link) / (motor * link * omega * omega);
        arm.shaft_damping_s[1] = 2.0 * FLEXIBLE_DAMPING / omega;
    }
    arm
}
