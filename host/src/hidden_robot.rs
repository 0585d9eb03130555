//! Robots that a simulated board is made of: the truth that identification has to find.

use shared::arm::Arm;
use shared::effects::Effects;
use shared::plant::Plant;

use crate::effects::{self, EffectError};
use crate::model::{Effect, Model};
use crate::random::Random;
use crate::robot::Robot;

/// How far a hidden robot's parameters lie from the reference robot's, at most, as a share.
const SPREAD: f64 = 0.1;

/// What a simulated robot really is.
#[derive(Clone, Debug, PartialEq)]
pub struct HiddenRobot {
    /// f1..f9.
    pub f: [f64; 9],
    /// Viscous friction at the motors in N m s/rad.
    pub viscous_nm_s_per_rad: [f64; 2],
    /// Coulomb friction at the motors in N m.
    pub coulomb_nm: [f64; 2],
    /// Effects beyond these, by name and as the plant takes them.
    beyond: Option<(Vec<Effect>, Effects<f64>)>,
}

impl HiddenRobot {
    /// A robot drawn around the one to expect ([`Robot::expected_f`]): every f within 10 %, with the ties f3 = a3 f5 and f4 = a3 f6 that a
    /// real arm has, and friction within 10 % of the robot file's.
    pub fn draw(robot: &Robot, seed: u64) -> Self {
        let mut random = Random::new(seed, 1);
        loop {
            let mut near = |value: f64| value * random.between(1.0 - SPREAD, 1.0 + SPREAD);
            let mut f = robot.expected_f().map(&mut near);
            f[2] = robot.upper_arm_m * f[4];
            f[3] = robot.upper_arm_m * f[5];
            let known = Self::known_friction(robot);
            let hidden = Self {
                f,
                viscous_nm_s_per_rad: known[0].map(&mut near),
                coulomb_nm: known[1].map(&mut near),
                beyond: None,
            };
            // f1 − f2 is the motor's inertia seen through the gear: an arm without it cannot be.
            if hidden.f[0] > hidden.f[1] && hidden.arm(robot).check_inertia().is_ok() {
                return hidden;
            }
        }
    }

    /// The robot a model file describes, its effects included.
    pub fn from_model(model: &Model, robot: &Robot) -> Result<Self, EffectError> {
        let pair = |values: &[f64]| std::array::from_fn(|joint| values.get(joint).copied().unwrap_or(0.0));
        Self {
            f: model.f,
            viscous_nm_s_per_rad: pair(&model.viscous_nm_s_per_rad),
            coulomb_nm: pair(&model.coulomb_nm),
            beyond: None,
        }
        .with_effects(&model.effects, robot)
    }

    /// The same robot with further effects.
    pub fn with_effects(mut self, entries: &[Effect], robot: &Robot) -> Result<Self, EffectError> {
        let mut all = self.beyond.take().map_or_else(Vec::new, |(entries, _)| entries);
        all.extend_from_slice(entries);
        if !all.is_empty() {
            let effects = effects::from_entries(&all, robot)?;
            self.beyond = Some((all, effects));
        }
        Ok(self)
    }

    /// The effects it has, if any.
    pub fn effects(&self) -> Option<&Effects<f64>> {
        self.beyond.as_ref().map(|(_, effects)| effects)
    }

    /// The robot as a model file, with `provenance`.
    pub fn to_model(&self, provenance: toml::Table) -> Model {
        Model {
            f: self.f,
            f_standard_error: None,
            viscous_nm_s_per_rad: self.viscous_nm_s_per_rad.to_vec(),
            viscous_standard_error: None,
            coulomb_nm: self.coulomb_nm.to_vec(),
            coulomb_standard_error: None,
            effects: self.beyond.as_ref().map_or_else(Vec::new, |(entries, _)| entries.clone()),
            provenance,
        }
    }

    /// What an earlier measurement of the motors would have put into the robot file: this robot's friction.
    pub fn with_known_friction(&self, robot: &Robot) -> Robot {
        let mut robot = robot.clone();
        for (index, joint) in robot.joints.iter_mut().enumerate().take(2) {
            joint.viscous_friction_nm_s_per_rad = Some(self.viscous_nm_s_per_rad[index]);
            joint.coulomb_friction_nm = Some(self.coulomb_nm[index]);
        }
        robot
    }

    /// The plant to simulate, on the drives of `robot`; without its effects.
    pub fn plant(&self, robot: &Robot) -> Plant<f64> {
        let drive = |joint: usize| {
            let mut drive = robot.joints[joint].drive();
            drive.viscous_friction_nm_s_per_rad = self.viscous_nm_s_per_rad[joint];
            drive.coulomb_friction_nm = self.coulomb_nm[joint];
            drive
        };
        Plant { arm: self.arm(robot), drives: [drive(0), drive(1)] }
    }

    fn arm(&self, robot: &Robot) -> Arm<f64> {
        Arm { f: self.f, gravity_m_s2: robot.gravity_m_s2 }
    }

    /// Viscous and Coulomb friction of the robot file, the paper's where it gives none.
    fn known_friction(robot: &Robot) -> [[f64; 2]; 2] {
        let paper = Robot::paper();
        let of = |value: fn(&crate::robot::Joint) -> Option<f64>| {
            std::array::from_fn(|index| {
                robot.joints.get(index).and_then(value).or_else(|| value(&paper.joints[index])).unwrap_or(0.0)
            })
        };
        [of(|joint| joint.viscous_friction_nm_s_per_rad), of(|joint| joint.coulomb_friction_nm)]
    }
}

#[cfg(test)]
mod tests {
    use shared::arm::REFERENCE_F;

    use super::*;

    #[test]
    fn hidden_robots_are_near_the_reference_robot_and_real() {
        let robot = Robot::paper();
        for seed in 0..200 {
            let hidden = HiddenRobot::draw(&robot, seed);
            for (index, (value, reference)) in hidden.f.iter().zip(REFERENCE_F).enumerate() {
                // f3 and f4 follow from f5 and f6, which the table's three decimals round a little differently.
                let slack = if index == 2 || index == 3 { 0.03 } else { 0.0 };
                assert!((value / reference - 1.0).abs() <= SPREAD + slack, "seed {seed}: f{} = {value}", index + 1);
            }
            assert_eq!(hidden.f[3], robot.upper_arm_m * hidden.f[5]);
            hidden.plant(&robot).arm.check_inertia().unwrap();
        }
        assert_ne!(HiddenRobot::draw(&robot, 1), HiddenRobot::draw(&robot, 2));
    }
}
