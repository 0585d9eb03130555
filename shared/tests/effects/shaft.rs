//! Flexibility and backlash between motor and link.

use core::f64::consts::TAU;

use shared::effects::{JointEffects, Motion};

use crate::axis::{INERTIA, LINK, MOTOR, RATIO, STEP_S, TORQUE_CONSTANT, at, axis, near, step};

const OFF: JointEffects<f64> = JointEffects::OFF;

/// The compliance that gives the axis a mode: ω² = (1/motor + 1/link)/c.
fn compliance(mode_hz: f64) -> f64 {
    (1.0 / MOTOR + 1.0 / LINK) / (TAU * mode_hz).powi(2)
}

/// Instants at which the twist passes zero, and its extremes between, of a shaft let go.
fn ringing(effects: JointEffects<f64>, step_s: f64, duration_s: f64) -> (Vec<f64>, Vec<f64>) {
    let machine = axis(0.0, effects);
    let mut motion = Motion { twist_rad: [1e-3, 0.0], ..at(&machine, 0.0, 0.0, 0.0) };
    let (mut crossings, mut peaks, mut peak) = (Vec::new(), Vec::new(), 0.0_f64);
    while motion.time_s < duration_s {
        let next = step(&machine, &motion, 0.0, step_s);
        let (old, new) = (motion.twist_rad[0], next.twist_rad[0]);
        peak = peak.max(new.abs());
        if old * new < 0.0 {
            crossings.push(motion.time_s + step_s * old / (old - new));
            peaks.push(peak);
            peak = 0.0;
        }
        motion = next;
    }
    (crossings, peaks)
}

#[test]
fn two_masses_swing_with_their_mode_and_without_loss() {
    for mode_hz in [8.0, 20.0, 60.0] {
        let effects = JointEffects { compliance_rad_per_nm: compliance(mode_hz), ..OFF };
        let (crossings, peaks) = ringing(effects, STEP_S, 1.0);
        let last = crossings.len() - 1;
        let found_hz = 0.5 * last as f64 / (crossings[last] - crossings[0]);
        // The midpoint rule is slow by (ωh)²/12: 0.04 % at 60 Hz.
        near(found_hz, mode_hz, 5e-4 * mode_hz);
        // Half periods are caught to (ωh)²/8 of their peak; loss would be seen over all of them.
        let first = peaks[1..4].iter().fold(0.0_f64, |most, &peak| most.max(peak));
        let end = peaks[last - 3..].iter().fold(0.0_f64, |most, &peak| most.max(peak));
        near(end / first, 1.0, 2e-3);
    }
}

#[test]
fn damping_of_the_shaft_takes_its_share_of_each_period() {
    let mode = TAU * 20.0;
    // A damping ratio of 0.03: t = 2 ζ/ω.
    let effects = JointEffects { compliance_rad_per_nm: compliance(20.0), shaft_damping_s: 0.06 / mode, ..OFF };
    let (_, peaks) = ringing(effects, STEP_S, 0.5);
    // From half period to half period e^(−ζπ).
    let halves = 10;
    let ratio = peaks[1 + halves] / peaks[1];
    near(ratio.ln() / halves as f64, -0.03 * core::f64::consts::PI, 2e-3);
}

#[test]
fn flexible_shaft_twists_by_its_torque() {
    let machine = axis(0.0, JointEffects { compliance_rad_per_nm: 1e-4, shaft_damping_s: 5e-3, ..OFF });
    let mut motion = at(&machine, 0.0, 0.0, 0.0);
    for _ in 0..2000 {
        motion = step(&machine, &motion, -2.0, STEP_S);
    }
    // 25 N m at the joint accelerate 2 kg m²; the link's part goes through the shaft.
    let through = LINK * 25.0 / INERTIA;
    near(motion.gear_torque_nm[0], through, 1e-3);
    near(motion.twist_rad[0], 1e-4 * through, 1e-7);
}

#[test]
fn stiff_shafts_tend_to_the_rigid_one() {
    let run = |compliance_rad_per_nm: f64| {
        let machine = axis(0.1, JointEffects { compliance_rad_per_nm, ..OFF });
        let mut motion = at(&machine, 0.0, 0.5, 0.0);
        for k in 0..3000 {
            let command = 3.0 * (f64::from(k) * 0.01).sin();
            motion = step(&machine, &motion, command, STEP_S);
            assert!(motion.twist_rad[0].abs() < 1e-2, "{compliance_rad_per_nm}: unstable");
        }
        motion.motor.position_rad[0]
    };
    let rigid = run(0.0);
    // What is left of the twist is some c · 20 N m.
    for compliance in [1e-13, 1e-11, 1e-9, 1e-7, 1e-6] {
        near(run(compliance), rigid, 1e-9 + 2e3 * compliance);
    }
}

#[test]
fn motor_crosses_the_gap_alone_before_the_link_moves() {
    let gap_rad = 2e-3;
    let machine = axis(0.0, JointEffects { gap_rad, ..OFF });
    let mut motion = at(&machine, 0.0, 0.0, 0.0);
    near(motion.twist_rad[0], 0.5 * gap_rad, 1e-12);
    // Away from the flank the teeth are on: 6 N m at the joint on the motor alone.
    let torque = -6.0;
    let command = torque / (RATIO * TORQUE_CONSTANT);
    let crossing_s = (2.0 * gap_rad * MOTOR / 6.0_f64).sqrt();
    let step_s = 1e-5;
    while motion.twist_rad[0] > -0.5 * gap_rad + 1e-12 {
        let next = step(&machine, &motion, command, step_s);
        if next.twist_rad[0] > -0.5 * gap_rad + 1e-12 {
            let link = next.motor.position_rad[0] - next.twist_rad[0] + 0.5 * gap_rad;
            near(link, 0.0, 1e-12);
            near(next.gear_torque_nm[0], 0.0, 1e-9);
        }
        motion = next;
    }
    near(motion.time_s, crossing_s, 2.0 * step_s);
    near(motion.motor.position_rad[0], -gap_rad, 3e-6);
    // The teeth meet without rebound: what the motor had of momentum both share from then on.
    let shared = torque * crossing_s / INERTIA;
    for _ in 0..3 {
        motion = step(&machine, &motion, 0.0, step_s);
    }
    near(motion.motor.velocity_rad_s[0], shared, 2e-2 * shared.abs());
    near(motion.twist_rad[0], -0.5 * gap_rad, 1e-9);
    near(motion.twist_rate_rad_s[0], 0.0, 1e-9);
}

#[test]
fn gap_does_not_show_while_the_torque_keeps_its_sign() {
    let run = |gap_rad: f64| {
        let machine = axis(0.05, JointEffects { gap_rad, ..OFF });
        let mut motion = at(&machine, 0.0, 0.0, 0.0);
        for _ in 0..1000 {
            motion = step(&machine, &motion, -2.0, STEP_S);
        }
        motion.motor.position_rad[0]
    };
    near(run(1e-3), run(0.0), 1e-9);
}
