//! One case: a machine drawn, recorded three times, and its files.

use std::io::{Error, Result};
use std::path::Path;

use toml::{Table, Value};

use crate::simulator::{FourierSeries, Reference, Robot, TorqueNoise, robot_toml};

use super::draw::Draw;
use super::library::{self, Injected, NEED_A_BASELINE, OF_BOTH_JOINTS, Peaks};
use super::machine::Machine;
use super::outside;
use super::plan::{Hidden, Planned};
use super::run::{Record, Settings, record, rms};

/// Share of cases without a baseline model, where the hidden effect allows it.
const WITHOUT_BASELINE: f64 = 0.15;

/// Share of cases whose robot has a converter that rounds the command, and records it.
const WITH_CONVERTER: f64 = 0.4;

/// Share of cases where the phase of what is periodic in motor angle differs from record to record.
const REHOMED: f64 = 0.3;

/// Records of a case; the last is kept to check.
pub const RECORDS: usize = 3;

/// A case before it is recorded.
#[derive(Clone, Debug)]
pub struct Case {
    /// What was planned.
    pub planned: Planned,
    /// Its number in the benchmark.
    pub number: u64,
    /// The machine of each record.
    pub machines: Vec<Machine>,
    /// The same without anything hidden.
    pub healthy: Vec<Machine>,
    /// Where each record goes.
    pub references: Vec<Reference>,
    /// How each record is made.
    pub settings: Vec<Settings>,
    /// What was hidden.
    pub injected: Vec<Injected>,
    /// The healthy machine's records.
    pub healthy_records: Vec<Record>,
    /// A model as an identification of the healthy robot gives it, if the case has one.
    pub baseline: Option<Baseline>,
    /// Phases of what is periodic in motor angle differ from record to record.
    pub rehomed: bool,
    robot: Robot,
}

/// A model with standard errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Baseline {
    /// f1..f9 and their standard errors.
    pub f: [[f64; 2]; 9],
    /// Viscous friction of each motor in N m s/rad and its standard error.
    pub viscous_nm_s_per_rad: [[f64; 2]; 2],
    /// Coulomb friction of each motor in N m and its standard error.
    pub coulomb_nm: [[f64; 2]; 2],
}

impl Baseline {
    /// Values with errors drawn from their own standard errors around `truth`.
    fn draw(truth: &Machine, draw: &mut Draw) -> Self {
        const F: [f64; 9] = [0.003, 0.003, 0.003, 0.003, 0.003, 0.003, 0.012, 0.004, 0.006];
        const VISCOUS_SHARE: f64 = 0.005;
        const COULOMB_SHARE: f64 = 0.003;
        let quality = draw.logarithmic(0.7, 1.4);
        let mut around = |value: f64, error: f64| [value + error * quality * draw.gaussian(), error * quality];
        let f = std::array::from_fn(|index| around(truth.base.0[index], F[index]));
        let friction = truth.joints.map(|joint| joint.friction);
        Self {
            f,
            viscous_nm_s_per_rad: friction
                .map(|friction| around(friction.viscous_nm_s_per_rad, VISCOUS_SHARE * friction.viscous_nm_s_per_rad)),
            coulomb_nm: friction.map(|friction| around(friction.coulomb_nm, COULOMB_SHARE * friction.coulomb_nm)),
        }
    }

    /// The model file (design.md §8).
    #[must_use]
    pub fn to_toml(&self) -> String {
        let list = |values: &[[f64; 2]], part: usize| {
            Value::Array(values.iter().map(|value| Value::Float(value[part])).collect())
        };
        let mut f = Table::new();
        f.insert("value".to_owned(), list(&self.f, 0));
        f.insert("standard_error".to_owned(), list(&self.f, 1));
        let mut friction = Table::new();
        for (name, values) in [("viscous", &self.viscous_nm_s_per_rad), ("coulomb", &self.coulomb_nm)] {
            let unit = if name == "viscous" { "nm_s_per_rad" } else { "nm" };
            friction.insert(format!("{name}_{unit}"), list(values, 0));
            friction.insert(format!("{name}_standard_error"), list(values, 1));
        }
        let mut provenance = Table::new();
        provenance.insert("tool".to_owned(), Value::String("identified on the healthy robot".to_owned()));
        Table::from_iter([
            ("f".to_owned(), Value::Table(f)),
            ("friction".to_owned(), Value::Table(friction)),
            ("provenance".to_owned(), Value::Table(provenance)),
        ])
        .to_string()
    }
}

impl Case {
    /// Draws case `number` of the benchmark `seed`.
    #[must_use]
    pub fn draw(planned: &Planned, seed: u64, number: u64) -> Self {
        let mut draw = Draw::of_case(seed, number);
        let mut real = Robot::draw(draw.seed());
        // What the file says of the robot is its maker's: nominal friction, nominal delay, g by convention.
        let robot = Robot::reference();
        real.command_delay_s += draw.between(-8e-6, 8e-6);
        real.gravity_m_s2 += draw.between(-0.003, 0.003);
        for drive in &mut real.drives {
            drive.torque_constant_nm_per_a *= 1.0 + 2e-4 * draw.gaussian();
        }
        let mut healthy = Machine::healthy(&real, draw.between(170e-6, 215e-6));
        healthy.converter = draw.chance(WITH_CONVERTER);
        let joint_offset = [0, 1].map(|joint| 2e-3 * healthy.joints[joint].friction.coulomb_nm * draw.gaussian());
        for (part, offset_nm) in healthy.joints.iter_mut().zip(joint_offset) {
            part.torque_offset_nm = offset_nm;
            part.encoder_phase_counts = draw.between(0.0, 1.0);
        }
        let healthy = vec![healthy; RECORDS];

        let references = draw_references(&mut draw);
        let torque_noise = planned.noisy.then(|| {
            let share = draw.logarithmic(0.005, 0.02);
            TorqueNoise {
                standard_deviation_nm: healthy[0].joints.map(|joint| share * joint.friction.coulomb_nm),
                correlation_time_s: draw.logarithmic(0.035, 0.07),
            }
        });
        let sensor_gain = [0, 1].map(|_| 1.0 + 2e-3 * draw.gaussian());
        let sensor_zero = [0, 1].map(|_| 2e-3 * draw.gaussian());
        let settings: Vec<Settings> = (0..RECORDS)
            .map(|_| Settings {
                hold_s: draw.between(0.8, 1.8),
                start_off_rad: [draw.between(-0.004, 0.004), draw.between(-0.004, 0.004)],
                current_noise_a: draw.between(0.015, 0.03),
                current_sensor_gain: sensor_gain,
                current_sensor_zero_a: sensor_zero,
                torque_noise,
                ..Settings::quiet(draw.seed())
            })
            .collect();

        let healthy_records: Vec<Record> =
            (0..RECORDS).map(|index| record(&healthy[index], &robot, &references[index], &settings[index])).collect();
        let peaks = peaks(&healthy, &healthy_records, draw.between(1.3, 2.0));
        let durations_s: Vec<f64> = references
            .iter()
            .map(|reference| reference.ticks(robot.record_period_s) as f64 * robot.record_period_s)
            .collect();
        let rehomed = draw.chance(REHOMED);
        let mut machines = healthy.clone();
        let around = (&peaks, durations_s.as_slice(), rehomed);
        let size = planned.tier.size;
        let injected = match planned.hidden {
            Hidden::Null => Vec::new(),
            Hidden::Single { name, joint } => {
                vec![library::inject(&mut machines, name, joint, size, around, &mut draw)]
            }
            Hidden::Outside { name, joint } => vec![outside::put(&mut machines, name, joint, size, &mut draw)],
            Hidden::Pair => draw_pair(&mut draw)
                .map(|(name, joint)| library::inject(&mut machines, name, joint, size, around, &mut draw))
                .into(),
        };
        let needs_baseline = injected.iter().any(|effect| NEED_A_BASELINE.contains(&effect.name.as_str()));
        let has_baseline = !draw.chance(WITHOUT_BASELINE) || needs_baseline;
        let baseline = has_baseline.then(|| Baseline::draw(&healthy[0], &mut draw));
        Self {
            planned: planned.clone(),
            number,
            machines,
            healthy,
            references,
            settings,
            injected,
            healthy_records,
            baseline,
            rehomed,
            robot,
        }
    }

    /// Records the case.
    #[must_use]
    pub fn record(&self) -> Vec<Record> {
        (0..RECORDS)
            .map(|index| record(&self.machines[index], &self.robot, &self.references[index], &self.settings[index]))
            .collect()
    }

    /// Records the case and writes its files into `folder`: `robot.toml`, `model.toml` if it has one, `fit-1.csv`,
    /// `fit-2.csv`, `check-1.csv` and the sealed `truth.toml`.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        std::fs::create_dir_all(folder)?;
        let records = self.record();
        std::fs::write(folder.join("robot.toml"), robot_toml(&self.robot))?;
        if let Some(baseline) = &self.baseline {
            std::fs::write(folder.join("model.toml"), baseline.to_toml())?;
        }
        for (name, record) in ["fit-1.csv", "fit-2.csv", "check-1.csv"].iter().zip(&records) {
            std::fs::write(folder.join(name), record.to_csv(self.healthy[0].converter))?;
        }
        let truth = self.truth(&records).to_string();
        // Last: a folder with a truth is complete.
        std::fs::write(folder.join("truth.toml"), truth).map_err(Error::from)
    }

    /// The sealed truth.
    #[must_use]
    pub fn truth(&self, records: &[Record]) -> Table {
        let text = |text: &str| Value::String(text.to_owned());
        let numbers = |values: &[f64]| Value::Array(values.iter().copied().map(Value::Float).collect());
        let kind = match self.planned.hidden {
            Hidden::Null => "null",
            Hidden::Single { .. } => "single",
            Hidden::Outside { .. } => "outside",
            Hidden::Pair => "pair",
        };
        let [counts, of_coulomb] = self.sizes(records);
        let mut table = Table::from_iter([
            ("kind".to_owned(), text(kind)),
            ("noisy".to_owned(), Value::Boolean(self.planned.noisy)),
            ("baseline".to_owned(), Value::Boolean(self.baseline.is_some())),
            ("rehomed".to_owned(), Value::Boolean(self.rehomed)),
            ("size_counts".to_owned(), numbers(&counts)),
            ("size_of_coulomb".to_owned(), numbers(&of_coulomb)),
            ("f".to_owned(), numbers(&self.machines[0].base.0)),
        ]);
        if self.planned.hidden != Hidden::Null {
            table.insert("tier".to_owned(), text(self.planned.tier.name));
            table.insert("size".to_owned(), Value::Float(self.planned.tier.size));
        }
        let effects = self.injected.iter().map(|effect| {
            let parameters = effect.parameters.iter().map(|(name, value)| (name.clone(), Value::Float(*value)));
            Value::Table(Table::from_iter([
                ("name".to_owned(), text(&effect.name)),
                ("joint".to_owned(), text(&effect.joint)),
                ("parameters".to_owned(), Value::Table(parameters.collect())),
            ]))
        });
        table.insert("effect".to_owned(), Value::Array(effects.collect()));
        table
    }

    /// What the hidden changes on the records to fit, joint by joint: the error in counts rms, and the motor torque
    /// of the command in shares of Coulomb friction, rms.
    #[must_use]
    pub fn sizes(&self, records: &[Record]) -> [[f64; 2]; 2] {
        let over = |gap: &dyn Fn(usize) -> [f64; 2]| -> [f64; 2] {
            let gaps: Vec<[f64; 2]> = (0..RECORDS - 1).map(gap).collect();
            std::array::from_fn(|joint| rms(gaps.iter().map(|gap| gap[joint])))
        };
        let counts = over(&|index| records[index].gap_counts(&self.healthy_records[index]));
        let amperes = over(&|index| records[index].command_gap_a(&self.healthy_records[index]));
        let of_coulomb = std::array::from_fn(|joint| {
            let part = &self.healthy[0].joints[joint];
            amperes[joint] * part.torque_constant_nm_per_a / part.friction.coulomb_nm
        });
        [counts, of_coulomb]
    }
}

/// Two movements to fit and one to check, all different.
fn draw_references(draw: &mut Draw) -> Vec<Reference> {
    let first = Reference::Paper { period_s: draw.between(3.4, 4.1) };
    let second = Reference::Paper { period_s: draw.between(4.6, 5.8) };
    let series = |draw: &mut Draw| Reference::Fourier(FourierSeries::draw(draw.seed(), draw.between(3.8, 5.2)));
    // In half the cases the check is a movement of another kind, in the others one of the fitted ones is.
    if draw.chance(0.5) {
        vec![first, second, series(draw)]
    } else {
        let check = Reference::Paper { period_s: draw.between(4.15, 4.5) };
        vec![first, series(draw), check]
    }
}

fn peaks(machines: &[Machine], records: &[Record], winding_ohm: f64) -> Peaks {
    let mut peaks = Peaks { winding_ohm, ..Peaks::default() };
    for (machine, record) in machines.iter().zip(records).take(RECORDS - 1) {
        for joint in 0..2 {
            let emf = machine.joints[joint].torque_constant_nm_per_a;
            for (current_a, speed) in record.true_current_a[joint].iter().zip(&record.motor_speed_rad_s[joint]) {
                peaks.current_a[joint] = peaks.current_a[joint].max(current_a.abs());
                let voltage_v = (winding_ohm * current_a + emf * speed).abs();
                peaks.voltage_v[joint] = peaks.voltage_v[joint].max(voltage_v);
            }
        }
    }
    peaks
}

/// Two different effects, not of the same family, each on a joint of its own drawing.
fn draw_pair(draw: &mut Draw) -> [(&'static str, usize); 2] {
    /// Effects that one set of recordings can hardly tell apart or that undo each other.
    const FAMILIES: [&[&str]; 6] = [
        &["asymmetric-friction", "torque-offset", "base-tilt"],
        &["viscous-friction", "back-emf", "asymmetric-viscous-friction", "quadratic-friction"],
        &["torque-constant", "payload", "gravity-spring", "load-dependent-friction"],
        &["joint-flexibility", "backlash"],
        &[
            "coulomb-friction",
            "stribeck-friction",
            "friction-drift",
            "position-dependent-friction",
            "amplifier-dead-zone",
        ],
        &["current-saturation", "voltage-saturation"],
    ];
    let family = |name: &str| FAMILIES.iter().position(|family| family.contains(&name));
    let pick = |draw: &mut Draw| {
        let name = library::NAMES[draw.index(library::NAMES.len())];
        (name, if OF_BOTH_JOINTS.contains(&name) { 0 } else { draw.index(2) })
    };
    let first = pick(draw);
    loop {
        let second = pick(draw);
        let related = family(first.0).is_some() && family(first.0) == family(second.0);
        if first.0 != second.0 && !related {
            return [first, second];
        }
    }
}
