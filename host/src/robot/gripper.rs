//! What an arm may carry, and where.

use shared::arm::Load;

use super::{Robot, RobotError};

/// The gripper: where a load is held, and how heavy one may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gripper {
    /// Largest mass the arm may carry, kg, 0.05 to 100.
    pub maximum_load_kg: f64,
    /// Where it holds a load: the load's centre of mass in frame 3, m; at most 5 m from the axis of joint 3.
    pub grasp_m: [f64; 2],
}

impl Gripper {
    /// The reference robot's: at the end of the forearm, where it has its tool.
    pub const REFERENCE: Self = Self { maximum_load_kg: 2.5, grasp_m: [-0.02, -0.53] };

    /// A load of `mass_kg` in it, small beside its distance from the joint.
    pub fn holding(&self, mass_kg: f64) -> Load<f64> {
        Load { mass_kg, centre_m: self.grasp_m, inertia_kg_m2: 0.0 }
    }

    /// What to add to the file of a robot that does not say what it carries: the load's centre lies along the forearm, as far
    /// as the upper arm is long.
    pub fn lines_to_add(robot: &Robot) -> String {
        let f = robot.expected_f();
        let (x, y) = (f[4], f[5]);
        let distance = x.hypot(y);
        let along = if distance > 0.0 { [x / distance, y / distance] } else { [0.0, -1.0] };
        // Without a sign on a zero.
        let [x, y] = along.map(|share| (share * robot.upper_arm_m * 100.0).round() / 100.0 + 0.0);
        format!(
            "add to the robot file as its last lines\n\
             [gripper]\n\
             maximum_load_kg = 1.0\n\
             grasp_m = [{x:?}, {y:?}]\n\
             with your numbers: the greatest mass in the gripper, and its centre in frame 3 from the axis of joint 3, here \
             along the forearm"
        )
    }

    /// Accepts only what a load can be identified with.
    pub(super) fn check(&self) -> Result<(), RobotError> {
        let refuse = |field, value: String, limit, remedy| Err(RobotError { joint: None, field, value, limit, remedy });
        if !(0.05..=100.0).contains(&self.maximum_load_kg) {
            let value = self.maximum_load_kg.to_string();
            return refuse("maximum_load_kg", value, "0.05 to 100 kg", "give the greatest mass in the gripper in kg");
        }
        let [x, y] = self.grasp_m;
        if !(0.0..=5.0).contains(&x.hypot(y)) {
            let remedy = "give a held load's centre in frame 3 in m; the reference robot's forearm lies along −y";
            return refuse("grasp_m", format!("[{x}, {y}]"), "within 5 m of the axis of joint 3", remedy);
        }
        Ok(())
    }
}
