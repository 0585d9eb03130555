//! From a model file to the model that the board's computed torque runs with: effects folded into numbers that it has
//! anyway where that is exact, the rest as numbers of its feedforward, and what it cannot compensate by name.

use shared::arm::{Load, PARAMETERS};
use shared::effects::ArmEffects;
use shared::protocol::{JointCompensation, Model as BoardModel};

use crate::board_setup::{SetupError, configuration};
use crate::effects;
use crate::model::{Effect, Model};
use crate::robot::Robot;

/// Why computed torque cannot compensate an effect of the library; `None` where it can.
///
/// It knows the reference motion, and what the drive has to exert in it. It does not know what happens between motor and
/// link, nor when something happens once; and it commands a current, so what keeps the current from its command is the
/// amplifier's.
pub fn why_not(name: &str) -> Option<&'static str> {
    Some(match name {
        "friction-drift" => "it changes in time",
        "transmission-error" => "it is in the measured position, which the controller goes by",
        "joint-flexibility" | "backlash" => "it is between motor and link, where no encoder looks",
        "current-lag" | "current-saturation" | "voltage-saturation" | "amplifier-dead-zone" => {
            "it is between command and current, in the amplifier"
        }
        "count-loss" | "external-contact" => "it happens at an instant that nobody foresees",
        _ => return None,
    })
}

/// Whether the phase of an effect counts from where the encoder was switched on.
pub fn has_phase(effect: &Effect) -> bool {
    matches!(effect.name.as_str(), "torque-ripple" | "cogging")
}

/// A model file in the protocol's terms, tied to the robot it is for, with the effects that computed torque compensates.
pub fn board_model(robot: &Robot, model: &Model) -> Result<BoardModel, SetupError> {
    let robot_identity = configuration(robot)?.robot_identity();
    let all = effects::from_entries(&model.effects, robot)?;
    let pair = |values: &[f64]| -> [f64; 2] { std::array::from_fn(|joint| values.get(joint).copied().unwrap_or(0.0)) };
    let (viscous, coulomb) = (pair(&model.viscous_nm_s_per_rad), pair(&model.coulomb_nm));
    let motor_inertia = effects::motor_inertia_kg_m2(robot, model.f, all);
    let [second, third] = &all.joints;
    let torque_constant =
        |joint: usize| robot.joints[joint].torque_constant_nm_per_a * (1.0 + all.joints[joint].torque_constant_change);
    let viscous_friction_nm_s_per_rad = [0, 1].map(|joint: usize| {
        let effects = &all.joints[joint];
        // Current that the back-EMF takes away is replaced by the torque it would have given.
        viscous[joint] + effects.viscous_change_nm_s_per_rad + torque_constant(joint) * effects.back_emf_a_s_per_rad
    });
    let coulomb_friction_nm =
        [0, 1].map(|joint: usize| (coulomb[joint] + all.joints[joint].coulomb_change_nm).max(0.0));
    for joint in 0..2 {
        robot.check_viscous_friction(joint, viscous_friction_nm_s_per_rad[joint])?;
        robot.check_coulomb_friction(joint, coulomb_friction_nm[joint])?;
    }
    Ok(BoardModel {
        robot_identity,
        f: loaded_and_leaning(model.f, &all.arm),
        viscous_friction_nm_s_per_rad,
        coulomb_friction_nm,
        compensation: [(second, motor_inertia[0]), (third, motor_inertia[1])].map(|(joint, inertia)| {
            JointCompensation {
                // To a motor that moves, friction that differs by direction is an offset of half the difference.
                torque_offset_nm: (joint.torque_offset_nm + 0.5 * joint.coulomb_asymmetry_nm) as f32,
                torque_constant_change: joint.torque_constant_change as f32,
                viscous_asymmetry_nm_s_per_rad: joint.viscous_asymmetry_nm_s_per_rad as f32,
                quadratic_nm_s2_per_rad2: joint.quadratic_nm_s2_per_rad2 as f32,
                stribeck_nm: joint.stribeck_nm as f32,
                stribeck_velocity_rad_s: joint.stribeck_velocity_rad_s as f32,
                stribeck_sharpness: joint.stribeck_sharpness as f32,
                load_friction_coefficient: joint.load_friction_coefficient as f32,
                motor_inertia_kg_m2: inertia as f32,
                position_friction_nm: joint.position_friction_nm as f32,
                position_friction_order: joint.position_friction_order as f32,
                position_friction_phase_rad: joint.position_friction_phase_rad as f32,
                ripple_share: joint.ripple_share as f32,
                ripple_order: joint.ripple_order as f32,
                ripple_phase_rad: joint.ripple_phase_rad as f32,
                cogging_nm: joint.cogging_nm as f32,
                cogging_order: joint.cogging_order as f32,
                cogging_phase_rad: joint.cogging_phase_rad as f32,
                spring_nm: joint.spring_nm as f32,
                spring_angle_rad: joint.spring_angle_rad as f32,
            }
        }),
    })
}

/// The same model without any effect; `None` where it has none that computed torque compensates.
pub fn without_effects(model: &Model) -> Option<Model> {
    let compensated = model.effects.iter().any(|effect| why_not(&effect.name).is_none());
    compensated.then(|| Model { effects: Vec::new(), ..model.clone() })
}

/// f1..f9 of an arm that carries the body and leans as `effects` say. Both exact: a body adds to f, and f5, f6, f8 and f9
/// are in the gravity alone, as coefficients of sines and cosines that a lean turns into each other.
fn loaded_and_leaning(mut f: [f64; PARAMETERS], effects: &ArmEffects<f64>) -> [f64; PARAMETERS] {
    let load = Load {
        mass_kg: effects.payload_kg,
        centre_m: [effects.payload_x_m, effects.payload_y_m],
        inertia_kg_m2: effects.payload_kg * effects.payload_gyration_m2,
    };
    for (f, delta) in f.iter_mut().zip(load.delta_f(effects.upper_arm_m)) {
        *f += delta;
    }
    let (sine, cosine) = effects.tilt_rad.sin_cos();
    let [_, _, _, _, f5, f6, _, f8, f9] = f;
    f[4] = f5 * cosine - f6 * sine;
    f[5] = f6 * cosine + f5 * sine;
    f[7] = f8 * cosine + f9 * sine;
    f[8] = f9 * cosine - f8 * sine;
    f
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hidden_robot::HiddenRobot;
    use shared::arm::{Arm, Pose};
    use shared::effects::catalogue::{LIBRARY, Scope};

    fn model_with(text: &str) -> (Robot, Model) {
        let robot = Robot::paper();
        let mut model = HiddenRobot::draw(&robot, 5).to_model(toml::Table::new());
        model.effects = vec![effects::parse(text).unwrap()];
        (robot, model)
    }

    /// Gravity on a base that leans: every angle of the arm against the vertical is larger by the lean.
    #[test]
    fn a_lean_and_a_load_become_f_exactly() {
        let (robot, model) = model_with("base-tilt:angle_rad=0.3");
        let folded = Arm { f: board_model(&robot, &model).unwrap().f, gravity_m_s2: 9.81 };
        for q in [[-1.2, 0.3], [0.1, 1.1], [-0.4, 0.0]] {
            let expected = model.arm(&robot).gravity_torque_nm(&Pose::at([q[0] + 0.3, q[1]]));
            let found = folded.gravity_torque_nm(&Pose::at(q));
            assert!((0..2).all(|joint| (expected[joint] - found[joint]).abs() < 1e-12), "{expected:?} {found:?}");
        }
        let (robot, model) = model_with("payload:mass_kg=2,x_m=0.1,y_m=-0.5,gyration_m2=0.01");
        let f = board_model(&robot, &model).unwrap().f;
        let inertia = 2.0 * (0.26 + 0.01);
        let expected = [model.f[0] + inertia, model.f[5] - 1.0, model.f[8] + 2.0 * robot.upper_arm_m];
        for (found, expected) in [f[0], f[5], f[8]].into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
    }

    #[test]
    fn levels_of_friction_become_friction() {
        let (robot, model) = model_with("back-emf:joint=3,current_a_s_per_rad=0.001");
        let board = board_model(&robot, &model).unwrap();
        let added = board.viscous_friction_nm_s_per_rad[1] - model.viscous_nm_s_per_rad[1];
        assert!((added - 0.001 * robot.joints[1].torque_constant_nm_per_a).abs() < 1e-15, "{added}");
        let (robot, model) = model_with("asymmetric-friction:joint=2,difference_nm=0.04");
        assert_eq!(board_model(&robot, &model).unwrap().compensation[0].torque_offset_nm, 0.02);
        let (robot, model) = model_with("coulomb-friction:joint=2,change_nm=-9");
        assert_eq!(board_model(&robot, &model).unwrap().coulomb_friction_nm[0], 0.0);
    }

    #[test]
    fn friction_that_a_drive_never_overcomes_is_refused_wherever_it_comes_from() {
        for (effect, told) in [
            ("coulomb-friction:joint=2,change_nm=2.9", "Coulomb friction of joint 2 is 3.0"),
            ("back-emf:joint=3,current_a_s_per_rad=0.2", "viscous friction of joint 3 is 0.05"),
        ] {
            let (robot, model) = model_with(effect);
            let refused = board_model(&robot, &model).unwrap_err().to_string();
            assert!(refused.contains(told) && refused.contains("correct the number"), "{refused}");
        }
    }

    /// An effect that nobody says why it is not compensated changes what the board is told.
    #[test]
    fn every_effect_of_the_library_is_compensated_or_has_a_reason_why_not() {
        for entry in LIBRARY {
            let joint = if entry.scope == Scope::Arm { effects::BOTH_JOINTS } else { "3" };
            let parameters =
                entry.parameters.iter().map(|parameter| (parameter.name.to_string(), parameter.typical)).collect();
            let (robot, mut model) = model_with("backlash:joint=3,gap_rad=0");
            let plain = board_model(&robot, &model).unwrap();
            model.effects = vec![Effect {
                name: entry.name.into(),
                joint: joint.into(),
                parameters,
                standard_error: Default::default(),
            }];
            let told = board_model(&robot, &model).unwrap() != plain;
            assert_eq!(told, why_not(entry.name).is_none(), "{}", entry.name);
            assert_eq!(without_effects(&model).is_some(), told, "{}", entry.name);
        }
    }
}
