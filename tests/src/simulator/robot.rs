//! The whole machine: arm, two drives, the clock of its loop; and random machines.

use std::f64::consts::TAU;

use super::base_parameters::BaseParameters;
use super::dynamics::Arm;
use super::noise::{Purpose, RandomStream};

/// One joint's drive with its position loop. Motor-side quantities.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Motor turns per joint turn; negative where the motor turns the other way.
    pub gear_ratio: f64,
    /// Encoder counts per motor turn, quadrature included.
    pub counts_per_rev: f64,
    /// Motor torque per ampere, in N m/A.
    pub torque_constant_nm_per_a: f64,
    /// Commanded current per count of error, in A/count.
    pub position_gain_a_per_count: f64,
    /// Weight β of the error's last change in the law `G (e + β (e - e_previous))`.
    pub lead: f64,
    /// The amplifier gives at most this current in either direction, in A.
    pub current_limit_a: f64,
    /// Viscous friction in N m s/rad.
    pub viscous_friction_nm_s_per_rad: f64,
    /// Coulomb friction in N m.
    pub coulomb_friction_nm: f64,
}

impl Drive {
    /// Encoder counts per radian of the joint, with the gear's sign.
    #[must_use]
    pub fn counts_per_joint_rad(&self) -> f64 {
        self.gear_ratio * self.counts_per_rev / TAU
    }
}

/// A simulated robot: everything that decides its recordings except the run itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// Name written to the robot file.
    pub name: String,
    /// Gravity in m/s².
    pub gravity_m_s2: f64,
    /// Time between recorded samples in seconds.
    pub record_period_s: f64,
    /// Time between samples of the position loop in seconds; a whole number of them make a record period.
    pub loop_period_s: f64,
    /// Time from sampling the error to the new current, in seconds; less than the loop period.
    pub command_delay_s: f64,
    /// The moving parts.
    pub arm: Arm,
    /// The drives of joints "2" and "3".
    pub drives: [Drive; 2],
}

impl Robot {
    /// The reference robot of design.md §2 and §3 under the default loop of 0.7 ms with half the limiting gain.
    #[must_use]
    pub fn reference() -> Self {
        Self {
            name: "PUMA 560, links 2 and 3".to_owned(),
            gravity_m_s2: 9.81,
            record_period_s: 0.7e-3,
            loop_period_s: 0.7e-3,
            command_delay_s: 30e-6,
            arm: Arm::Base(BaseParameters::REFERENCE),
            drives: [
                Drive {
                    gear_ratio: 107.8,
                    counts_per_rev: 800.0,
                    torque_constant_nm_per_a: 0.25,
                    position_gain_a_per_count: 0.036,
                    lead: 0.0,
                    current_limit_a: 12.0,
                    viscous_friction_nm_s_per_rad: 0.817e-3,
                    coulomb_friction_nm: 0.124,
                },
                Drive {
                    gear_ratio: -53.7,
                    counts_per_rev: 1000.0,
                    torque_constant_nm_per_a: 0.25,
                    position_gain_a_per_count: 0.048,
                    lead: 0.0,
                    current_limit_a: 12.0,
                    viscous_friction_nm_s_per_rad: 1.38e-3,
                    coulomb_friction_nm: 0.146,
                },
            ],
        }
    }

    /// A random robot around the reference one, decided by `seed` alone.
    ///
    /// Every `f` and every friction within ±10 %, except the small ones, which would hardly move: `f5` and `f8`
    /// within ±0.05 kg m. `f3 = a3 f5` and `f4 = a3 f6`, as on any real arm.
    #[must_use]
    pub fn draw(seed: u64) -> Self {
        const SPREAD: f64 = 0.1;
        const SMALL_SPREAD_KG_M: f64 = 0.05;
        let mut random = RandomStream::new(seed, Purpose::Robot);
        let mut robot = Self::reference();
        for drive in &mut robot.drives {
            drive.viscous_friction_nm_s_per_rad *= 1.0 + SPREAD * random.symmetric();
            drive.coulomb_friction_nm *= 1.0 + SPREAD * random.symmetric();
        }
        let [f1, f2, _, _, f5, f6, f7, f8, f9] = BaseParameters::REFERENCE.0;
        let base = loop {
            let mut around = |centre: f64| centre * (1.0 + SPREAD * random.symmetric());
            let (f1, f2, f6, f7, f9) = (around(f1), around(f2), around(f6), around(f7), around(f9));
            let mut near = |centre: f64| centre + SMALL_SPREAD_KG_M * random.symmetric();
            let candidate = BaseParameters::with_consistent_elbow(f1, f2, near(f5), f6, f7, near(f8), f9);
            if candidate.is_physical() {
                break candidate;
            }
        };
        robot.arm = Arm::Base(base);
        robot
    }

    /// The same machine with the loop of the paper's hardware card: 50 µs and the gains that hold ±10 counts
    /// (0.096 and 0.094 N m of motor torque per count).
    #[must_use]
    pub fn with_paper_loop(mut self) -> Self {
        self.loop_period_s = 50e-6;
        for (drive, gain_nm_per_count) in self.drives.iter_mut().zip([0.096, 0.094]) {
            drive.position_gain_a_per_count = gain_nm_per_count / drive.torque_constant_nm_per_a;
        }
        self
    }

    /// Loop samples per recorded sample.
    ///
    /// # Panics
    /// If the record period is not a whole number of loop periods.
    #[must_use]
    pub fn loops_per_record(&self) -> usize {
        let ratio = self.record_period_s / self.loop_period_s;
        let whole = ratio.round();
        assert!(
            whole >= 1.0 && (ratio - whole).abs() < 1e-6,
            "record period {} s is not a whole number of loop periods {} s",
            self.record_period_s,
            self.loop_period_s
        );
        whole as usize
    }
}
