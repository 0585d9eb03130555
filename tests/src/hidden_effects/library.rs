//! Every effect of the library as it is put into a machine: what "clear" means, which shape constants are drawn, and
//! the parameters that a scorer compares.
//!
//! `size` scales the strength: 1 is clear. Shape constants (orders, phases, speeds, instants) are drawn from ranges,
//! off any grid, and do not scale. Strengths themselves are drawn within ±20 % of the size, and their sign where both
//! signs make sense.

use super::draw::Draw;
use super::machine::{Contact, Machine, Slip, Transmission, VoltageLimit, Wave};

/// Names as `explain` must give them.
pub const NAMES: [&str; 26] = [
    "coulomb-friction",
    "viscous-friction",
    "asymmetric-friction",
    "asymmetric-viscous-friction",
    "stribeck-friction",
    "load-dependent-friction",
    "position-dependent-friction",
    "friction-drift",
    "quadratic-friction",
    "torque-offset",
    "torque-constant",
    "torque-ripple",
    "cogging",
    "transmission-error",
    "joint-flexibility",
    "backlash",
    "current-lag",
    "current-saturation",
    "voltage-saturation",
    "back-emf",
    "amplifier-dead-zone",
    "payload",
    "gravity-spring",
    "base-tilt",
    "count-loss",
    "external-contact",
];

/// Effects of the whole arm: no joint has them alone.
pub const OF_BOTH_JOINTS: [&str; 2] = ["payload", "base-tilt"];

/// Effects that a fit of the base parameters swallows almost whole: without a baseline nothing can show them, so their
/// cases always have one.
pub const NEED_A_BASELINE: [&str; 8] = [
    "coulomb-friction",
    "viscous-friction",
    "torque-constant",
    "back-emf",
    "payload",
    "gravity-spring",
    "base-tilt",
    "quadratic-friction",
];

/// One effect that was put in.
#[derive(Clone, Debug, PartialEq)]
pub struct Injected {
    /// Its name in [`NAMES`] or that of an [`Outside`](super::outside::Outside).
    pub name: String,
    /// "2", "3" or "both".
    pub joint: String,
    /// True parameters by name, with the unit in the name.
    pub parameters: Vec<(String, f64)>,
}

/// What a healthy run of this case reaches, joint by joint: the scale of saturations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Peaks {
    /// Largest magnitude of the current in A.
    pub current_a: [f64; 2],
    /// Resistance of a winding in Ω.
    pub winding_ohm: f64,
    /// Highest value of `|R i + Ke ω|` in V.
    pub voltage_v: [f64; 2],
}

/// Puts the effect `name` on `joint` (0 or 1) into the machines of all records of a case.
///
/// `durations_s` are the records' lengths, for instants. `rehomed` draws the phases of what is periodic in motor angle
/// anew in each record.
///
/// # Panics
/// If there is no such effect.
pub fn inject(
    machines: &mut [Machine],
    name: &str,
    joint: usize,
    size: f64,
    (peaks, durations_s, rehomed): (&Peaks, &[f64], bool),
    draw: &mut Draw,
) -> Injected {
    let part = machines[0].joints[joint];
    let link_kg_m2 = link_inertia_kg_m2(&machines[0], joint);
    let coulomb = part.friction.coulomb_nm;
    let viscous = part.friction.viscous_nm_s_per_rad;
    // Strengths differ by ±20 % from one case to the next.
    let size = size * draw.between(0.8, 1.2);
    let mut parameters: Vec<(String, f64)> = Vec::new();
    let mut note = |name: &str, value: f64| {
        parameters.push((name.to_owned(), value));
        value
    };
    let mut all = |change: &mut dyn FnMut(&mut Machine)| machines.iter_mut().for_each(change);
    match name {
        "coulomb-friction" => {
            let change = note("change_nm", draw.sign() * 0.25 * size * coulomb);
            all(&mut |machine| machine.joints[joint].friction.coulomb_nm += change);
        }
        "viscous-friction" => {
            let change = note("change_nm_s_per_rad", draw.sign() * 0.3 * size * viscous);
            all(&mut |machine| machine.joints[joint].friction.viscous_nm_s_per_rad += change);
        }
        "asymmetric-friction" => {
            let half = draw.sign() * 0.15 * size * coulomb;
            note("difference_nm", 2.0 * half);
            all(&mut |machine| machine.joints[joint].friction.coulomb_asymmetry_nm += half);
        }
        "asymmetric-viscous-friction" => {
            let half = draw.sign() * 0.3 * size * viscous;
            note("difference_nm_s_per_rad", 2.0 * half);
            all(&mut |machine| machine.joints[joint].friction.viscous_asymmetry_nm_s_per_rad += half);
        }
        "stribeck-friction" => {
            let extra = note("extra_nm", draw.sign() * 0.4 * size * coulomb);
            let speed = note("velocity_rad_s", draw.logarithmic(4.0, 16.0));
            let exponent = draw.between(1.6, 2.2);
            all(&mut |machine| {
                let friction = &mut machine.joints[joint].friction;
                friction.stribeck_nm = extra;
                friction.stribeck_speed_rad_s = speed;
                friction.stribeck_exponent = exponent;
            });
        }
        "load-dependent-friction" => {
            let share = note("coefficient", 0.08 * size);
            all(&mut |machine| machine.joints[joint].friction.load_share = share);
        }
        "position-dependent-friction" => {
            let wave = Wave { amplitude: 0.3 * size, order: draw.between(1.5, 6.0), phase_rad: draw.phase() };
            note("amplitude_nm", wave.amplitude * coulomb);
            note("order", wave.order);
            all(&mut |machine| machine.joints[joint].friction.over_angle = wave);
        }
        "friction-drift" => {
            let rate = draw.sign() * 0.06 * size;
            note("rate_nm_per_s", rate * coulomb);
            all(&mut |machine| machine.joints[joint].friction.drift_per_s = rate);
        }
        "quadratic-friction" => {
            let value = note("coefficient_nm_s2_per_rad2", draw.sign() * 3e-6 * size);
            all(&mut |machine| machine.joints[joint].friction.quadratic_nm_s2_per_rad2 = value);
        }
        "torque-offset" => {
            let offset = note("torque_nm", draw.sign() * 0.15 * size * coulomb);
            all(&mut |machine| machine.joints[joint].torque_offset_nm += offset);
        }
        "torque-constant" => {
            let change = note("relative_change", draw.sign() * 0.05 * size);
            all(&mut |machine| machine.joints[joint].torque_constant_nm_per_a *= 1.0 + change);
        }
        "torque-ripple" => {
            let wave = Wave { amplitude: 0.1 * size, order: draw.between(0.9, 5.0), phase_rad: draw.phase() };
            note("amplitude", wave.amplitude);
            note("order", wave.order);
            each_phase(machines, wave, rehomed, draw, |machine, wave| machine.joints[joint].ripple = wave);
        }
        "cogging" => {
            let wave = Wave { amplitude: 0.3 * size * coulomb, order: draw.between(0.9, 5.0), phase_rad: draw.phase() };
            note("amplitude_nm", wave.amplitude);
            note("order", wave.order);
            each_phase(machines, wave, rehomed, draw, |machine, wave| machine.joints[joint].cogging = wave);
        }
        "transmission-error" => {
            let wave = Wave { amplitude: 4.0 * size, order: draw.between(0.9, 2.6), phase_rad: draw.phase() };
            note("amplitude_rad", wave.amplitude / part.counts_per_rad().abs());
            note("order", wave.order);
            each_phase(machines, wave, rehomed, draw, |machine, wave| {
                machine.joints[joint].encoder_error_counts = wave;
            });
        }
        "joint-flexibility" => {
            let compliance = note("compliance_rad_per_nm", [3e-5, 9e-5][joint] * size);
            let stiffness = 1.0 / compliance;
            let damping = 2.0 * draw.between(0.01, 0.04) * (stiffness * link_kg_m2).sqrt();
            note("damping_s", damping * compliance);
            all(&mut |machine| machine.joints[joint].transmission = spring(stiffness, damping, 0.0));
        }
        "backlash" => {
            let gap = note("gap_rad", 0.0015 * size);
            // Teeth are far stiffer than what `joint-flexibility` means, and dull.
            let stiffness = link_kg_m2 * (std::f64::consts::TAU * draw.logarithmic(110.0, 180.0)).powi(2);
            let damping = 2.0 * draw.between(0.2, 0.4) * (stiffness * link_kg_m2).sqrt();
            all(&mut |machine| machine.joints[joint].transmission = spring(stiffness, damping, gap));
        }
        "current-lag" => {
            let lag = note("time_constant_s", 0.25e-3 * size);
            all(&mut |machine| machine.joints[joint].amplifier.lag_s = lag);
        }
        "current-saturation" => {
            let limit = note("limit_a", peaks.current_a[joint] * (1.0 - 0.06 * size));
            all(&mut |machine| machine.joints[joint].amplifier.limit_a = limit);
        }
        "voltage-saturation" => {
            let voltage = VoltageLimit {
                limit_v: note("supply_v", peaks.voltage_v[joint] * (1.0 - 0.03 * size)),
                resistance_ohm: note("winding_ohm", peaks.winding_ohm),
                emf_v_s_per_rad: part.torque_constant_nm_per_a,
            };
            all(&mut |machine| machine.joints[joint].amplifier.voltage = Some(voltage));
        }
        "back-emf" => {
            let lost = 0.3 * size * viscous / part.torque_constant_nm_per_a;
            note("current_a_s_per_rad", lost);
            all(&mut |machine| machine.joints[joint].amplifier.back_emf_a_s_per_rad = lost);
        }
        "amplifier-dead-zone" => {
            let dead_zone = note("width_a", 0.1 * size);
            all(&mut |machine| machine.joints[joint].amplifier.dead_zone_a = dead_zone);
        }
        "payload" => {
            let mass = note("mass_kg", 0.2 * size);
            let (x, y) = (note("x_m", draw.between(-0.06, 0.06)), note("y_m", draw.between(-0.55, -0.35)));
            let inertia = mass * draw.between(0.02_f64, 0.06).powi(2);
            all(&mut |machine| machine.base = machine.base.with_load(mass, x, y, inertia));
        }
        "gravity-spring" => {
            let strength = [3.0, 1.5][joint] * size;
            let wave = Wave { amplitude: strength, order: 1.0, phase_rad: draw.phase() };
            note("torque_nm", strength);
            note("angle_rad", -wave.phase_rad);
            all(&mut |machine| machine.joints[joint].balance_spring_nm = wave);
        }
        "base-tilt" => {
            let tilt = note("angle_rad", draw.sign() * 0.02 * size);
            all(&mut |machine| machine.base_tilt_rad += tilt);
        }
        "count-loss" => {
            let counts = note("counts", draw.sign() * (12.0 * size).round().max(1.0));
            for (machine, duration_s) in machines.iter_mut().zip(durations_s) {
                let time_s = duration_s * draw.between(0.15, 0.85);
                machine.joints[joint].slip = Some(Slip { time_s, counts });
            }
        }
        "external-contact" => {
            let motor_nm = draw.sign() * 0.35 * size * coulomb;
            let torque_nm = note("torque_nm", motor_nm * part.gear_ratio.abs());
            let length_s = note("duration_s", draw.between(0.25, 0.7));
            for (machine, duration_s) in machines.iter_mut().zip(durations_s) {
                let start_s = duration_s * draw.between(0.1, 0.75);
                machine.joints[joint].contact = Some(Contact { start_s, duration_s: length_s, torque_nm });
            }
        }
        _ => panic!("there is no effect {name}"),
    }
    let joint = if OF_BOTH_JOINTS.contains(&name) { "both" } else { ["2", "3"][joint] };
    Injected { name: name.to_owned(), joint: joint.to_owned(), parameters }
}

fn each_phase(
    machines: &mut [Machine],
    mut wave: Wave,
    rehomed: bool,
    draw: &mut Draw,
    set: impl Fn(&mut Machine, Wave),
) {
    for machine in machines {
        set(machine, wave);
        if rehomed {
            wave.phase_rad = draw.phase();
        }
    }
}

/// A spring with play and its damping, without hardening.
#[must_use]
pub fn spring(stiffness_nm_per_rad: f64, damping_nm_s_per_rad: f64, gap_rad: f64) -> Transmission {
    Transmission::Elastic { stiffness_nm_per_rad, hardening_nm_per_rad3: 0.0, damping_nm_s_per_rad, gap_rad }
}

/// Inertia in kg m² that a joint's spring carries in the middle of the workspace, without its motor.
#[must_use]
pub fn link_inertia_kg_m2(machine: &Machine, joint: usize) -> f64 {
    let middle = std::f64::consts::FRAC_PI_4;
    let mass = machine.base.equations([-middle, middle], [0.0; 2], 0.0).mass_kg_m2;
    mass[joint][joint] - machine.joints[joint].motor_inertia_kg_m2
}
