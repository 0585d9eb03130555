//! Which robot a model belongs to: a fingerprint of what f and friction rest on.

use crc::{CRC_32_ISO_HDLC, Crc};

use super::{Kind, Robot};

impl Robot {
    /// Eight hexadecimal digits that differ where a model identified with one robot file would be wrong with another: kind
    /// of robot, gravity, and each joint's name, gear ratio, counts per revolution and torque constant. Gains, limits,
    /// periods and what is known of friction may change without another identity.
    pub fn identity(&self) -> String {
        let kind = match self.kind {
            Kind::TwoLink => "two-link",
            Kind::SingleAxis => "single-axis",
        };
        let mut text = format!("{kind} {:e}", self.gravity_m_s2);
        for joint in &self.joints {
            let [ratio, counts] = [joint.gear_ratio, joint.counts_per_rev];
            text += &format!(" {} {ratio:e} {counts:e} {:e}", joint.name, joint.torque_constant_nm_per_a);
        }
        format!("{:08x}", Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(text.as_bytes()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_f_and_friction_rest_on_makes_another_robot() {
        let paper = Robot::paper();
        let changed = |change: fn(&mut Robot)| {
            let mut robot = paper.clone();
            change(&mut robot);
            robot.identity() != paper.identity()
        };
        assert!(changed(|robot| robot.joints[1].gear_ratio *= -1.0));
        assert!(changed(|robot| robot.joints[0].counts_per_rev = 801.0));
        assert!(changed(|robot| robot.joints[0].torque_constant_nm_per_a *= 1.001));
        assert!(changed(|robot| robot.gravity_m_s2 = 0.0));
        assert!(changed(|robot| robot.joints.swap(0, 1)));
        assert!(!changed(|robot| robot.name = "another name".into()));
        assert!(!changed(|robot| robot.loop_period_s = 0.00035));
        assert!(!changed(|robot| robot.joints[0].current_limit_a = 5.0));
        assert!(!changed(|robot| robot.computed_torque.bandwidth_rad_s = 100.0));
    }
}
