//! Dual numbers against derivatives known in closed form, and against differences of the plant itself.

use proptest::prelude::*;
use shared::arm::{Arm, REFERENCE_F};
use shared::drive::Drive;
use shared::dual::Dual;
use shared::plant::{Plant, State};
use shared::scalar::{Number, Scalar};

fn variable(value: f64) -> Dual<f64> {
    Dual { value, slope: 1.0 }
}

fn close(found: f64, expected: f64) -> bool {
    (found - expected).abs() <= 1e-12 * (1.0 + expected.abs())
}

proptest! {
    #[test]
    fn operations_follow_the_rules_of_derivatives(x in -3.0..3.0_f64, a in 0.5..2.0_f64) {
        let (v, c) = (variable(x), Dual::fixed(a));
        let (sine, cosine) = v.sin_cos();
        let positive = v * v + c;
        let cases = [
            (v * v - c * v, x * x - a * x, 2.0 * x - a),
            (c / positive, a / (x * x + a), -a * 2.0 * x / (x * x + a).powi(2)),
            (positive.sqrt(), (x * x + a).sqrt(), x / (x * x + a).sqrt()),
            (v.mul_add(v, c), x * x + a, 2.0 * x),
            (sine, x.sin(), x.cos()),
            (cosine, x.cos(), -x.sin()),
            (v.abs(), x.abs(), if x < 0.0 { -1.0 } else { 1.0 }),
            (v.clamp_abs(c), x.clamp(-a, a), if x.abs() < a { 1.0 } else { 0.0 }),
            (-v, -x, -1.0),
            (v.fix(), x.trunc(), 0.0),
        ];
        for (index, (found, value, slope)) in cases.into_iter().enumerate() {
            prop_assert!(close(found.value, value) && close(found.slope, slope), "case {index}: {found:?}");
        }
    }

    /// One step of the plant, differentiated by each of f1..f9 and by friction, against central differences. Velocities
    /// stay away from zero, where Coulomb friction has its corner.
    #[test]
    fn a_step_of_the_plant_is_differentiated(
        position in prop::array::uniform2(-1.5..1.5_f64),
        velocity in prop::array::uniform2(0.2..2.0_f64),
        torque in prop::array::uniform2(-0.5..0.5_f64),
        parameter in 0..11_usize,
    ) {
        let step = |number: &dyn Fn(usize, f64) -> Dual<f64>| {
            let drive = |joint: usize, gear_ratio: f64| Drive {
                gear_ratio: Dual::from_f64(gear_ratio),
                counts_per_rev: Dual::from_f64(1000.0),
                torque_constant_nm_per_a: Dual::from_f64(1.0),
                current_limit_a: Dual::from_f64(10.0),
                viscous_friction_nm_s_per_rad: Dual::from_f64(1e-3),
                coulomb_friction_nm: number(9 + joint, 0.13),
                torque_offset_nm: Dual::from_f64(0.0),
            };
            let arm = Arm {
                f: std::array::from_fn(|index| number(index, REFERENCE_F[index])),
                gravity_m_s2: Dual::from_f64(9.81),
            };
            let plant = Plant { arm, drives: [drive(0, 107.8), drive(1, -53.7)] }.prepare();
            let state = State { position_rad: position.map(Dual::from_f64), velocity_rad_s: velocity.map(Dual::from_f64) };
            plant.step(&state, torque.map(Dual::from_f64), Dual::from_f64(0.7e-3))
        };
        let exact = step(&|index, value| Dual { value, slope: f64::from(u8::from(index == parameter)) });
        let change = 1e-4;
        let at = |sign: f64| {
            step(&|index, value| Dual::from_f64(value + if index == parameter { sign * change } else { 0.0 }))
        };
        let (plus, minus) = (at(1.0), at(-1.0));
        for joint in 0..2 {
            let difference =
                (plus.velocity_rad_s[joint].value - minus.velocity_rad_s[joint].value) / (2.0 * change);
            let slope = exact.velocity_rad_s[joint].slope;
            prop_assert!((slope - difference).abs() <= 1e-6 * (1.0 + slope.abs()), "{slope} {difference}");
        }
    }
}
