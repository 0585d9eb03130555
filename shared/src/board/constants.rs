//! The configuration turned into what a tick needs, once.

use super::MID_SCALE;
use crate::arm::{Arm, Load, PARAMETERS};
use crate::control::{ComputedTorque, ComputedTorqueSettings, PositionLoop};
use crate::drive::Drive;
use crate::load::{LoadSettings, LoadSetup};
use crate::protocol::{Configuration, CurrentScale, Joint, JointCompensation, Model};
use crate::trajectory::MotionLimits;

/// Largest code of a 12-bit converter.
const LARGEST_CODE: u16 = 4095;

/// How many times the speed limit a counter may change in one tick before that is a jump, not a movement.
const JUMP_FACTOR: f32 = 4.0;

/// Counts added to the speed and jump limits: both ends of an interval are rounded to whole counts, and at a short
/// loop period the limit itself would be less than one.
const ROUNDING_COUNTS: i32 = 2;

/// One joint's constants in the board's precision.
#[derive(Clone, Copy, Debug)]
pub(super) struct JointTick {
    pub(super) joint: Joint,
    pub(super) drive: Drive<f32>,
    pub(super) counts_per_rad: f32,
    pub(super) position_loop: PositionLoop<f32>,
    pub(super) following_error_limit_counts: i32,
    pub(super) speed_limit_rad_s: f32,
    /// Counts in one record period at the speed limit.
    pub(super) travel_limit_counts: i32,
    /// Counts in one loop period that no movement explains.
    pub(super) jump_limit_counts: i32,
    pub(super) over_current_limit_a: f32,
    dac_codes_per_a: f32,
    dac_offset_a: f32,
    adc_a_per_code: f32,
    adc_offset_a: f32,
}

impl JointTick {
    fn new(joint: Joint, configuration: &Configuration) -> Self {
        let constants = &configuration.joints[joint.index()];
        let CurrentScale { dac_a_per_code, dac_offset_a, adc_a_per_code, adc_offset_a } = constants.current_scale;
        let drive = Drive {
            gear_ratio: constants.gear_ratio as f32,
            counts_per_rev: constants.counts_per_rev as f32,
            torque_constant_nm_per_a: constants.torque_constant_nm_per_a as f32,
            current_limit_a: constants.current_limit_a as f32,
            viscous_friction_nm_s_per_rad: constants.viscous_friction_nm_s_per_rad as f32,
            coulomb_friction_nm: constants.coulomb_friction_nm as f32,
            torque_offset_nm: 0.0,
        };
        let counts_per_s = (constants.speed_limit_rad_s * constants.counts_per_rad()).abs() as f32;
        // A float beyond the integers becomes the largest of them: then nothing is too fast.
        let counts_in = |period_ns: u32, factor: f32| {
            let counts = libm::ceilf(factor * counts_per_s * (period_ns as f32 * 1.0e-9)) as i32;
            counts.saturating_add(ROUNDING_COUNTS)
        };
        Self {
            joint,
            drive,
            counts_per_rad: constants.counts_per_rad() as f32,
            position_loop: PositionLoop {
                gain_a_per_count: constants.position_gain_a_per_count as f32,
                lead: constants.lead as f32,
            },
            following_error_limit_counts: constants.following_error_limit_counts as i32,
            speed_limit_rad_s: constants.speed_limit_rad_s as f32,
            travel_limit_counts: counts_in(configuration.common.record_period_ns, 1.0),
            jump_limit_counts: counts_in(configuration.common.loop_period_ns, JUMP_FACTOR),
            over_current_limit_a: constants.over_current_limit_a as f32,
            dac_codes_per_a: (1.0 / dac_a_per_code) as f32,
            dac_offset_a: dac_offset_a as f32,
            adc_a_per_code: adc_a_per_code as f32,
            adc_offset_a: adc_offset_a as f32,
        }
    }

    /// The code nearest a commanded current, and whether the current is beyond the converter.
    pub(super) fn command_code(&self, current_a: f32) -> (u16, bool) {
        // Half a code up, so that cutting the fraction off rounds; codes are not negative.
        let code = (current_a - self.dac_offset_a) * self.dac_codes_per_a + (f32::from(MID_SCALE) + 0.5);
        let beyond = f32::from(LARGEST_CODE) + 1.0;
        // The cast takes numbers below 0, and one that is none, for 0.
        ((code as u16).min(LARGEST_CODE), !(code >= 0.0 && code < beyond))
    }

    /// The measured current in A.
    pub(super) fn measured_a(&self, code: u16) -> f32 {
        (f32::from(code) - f32::from(MID_SCALE)) * self.adc_a_per_code + self.adc_offset_a
    }

    /// A reference in counts: `fix()` of the position in counts, as in the paper. The cast truncates toward zero.
    pub(super) fn reference_counts(&self, position_rad: f32) -> i32 {
        (position_rad * self.counts_per_rad) as i32
    }

    /// The joint angle in the middle of a count's cell, so that [`Self::reference_counts`] gives the count back.
    pub(super) fn position_rad(&self, counts: i32) -> f32 {
        crate::drive::centre_of_count(counts as f32) / self.counts_per_rad
    }
}

/// Everything a tick needs of the configuration, in the board's precision.
#[derive(Clone, Copy, Debug)]
pub(super) struct Constants {
    pub(super) joints: [JointTick; 2],
    pub(super) gravity_m_s2: f32,
    pub(super) loop_period_ns: u64,
    pub(super) record_period_ns: u64,
    /// Loop ticks from row to row.
    pub(super) loops_per_record: u32,
    /// From sampling to the middle of the interval in which the command acts.
    pub(super) ahead_ns: u64,
    pub(super) link_timeout_ns: u64,
    pub(super) current_limit_time_ns: u64,
    pub(super) stop_time_ns: u64,
    pub(super) motion_limits: MotionLimits,
    computed_torque: ComputedTorqueSettings<f32>,
}

impl Constants {
    /// From a configuration that passed its check.
    #[inline]
    pub(super) fn new(configuration: &Configuration) -> Self {
        let common = &configuration.common;
        let torque = &common.computed_torque;
        Self {
            joints: Joint::ALL.map(|joint| JointTick::new(joint, configuration)),
            gravity_m_s2: common.gravity_m_s2 as f32,
            loop_period_ns: u64::from(common.loop_period_ns),
            record_period_ns: u64::from(common.record_period_ns),
            loops_per_record: common.record_period_ns.checked_div(common.loop_period_ns).unwrap_or(1),
            ahead_ns: u64::from(common.loop_period_ns) / 2 + u64::from(common.command_delay_ns),
            link_timeout_ns: common.link_timeout_ns,
            current_limit_time_ns: common.current_limit_time_ns,
            stop_time_ns: common.stop_time_ns,
            motion_limits: configuration.motion_limits,
            computed_torque: ComputedTorqueSettings {
                bandwidth_rad_s: torque.bandwidth_rad_s as f32,
                damping_ratio: torque.damping_ratio as f32,
                observer_bandwidth_rad_s: torque.observer_bandwidth_rad_s as f32,
                friction_switch_motor_rad_s: torque.friction_switch_motor_rad_s as f32,
            },
        }
    }

    /// Encoder counts per radian of both joints.
    pub(super) fn counts_per_rad(&self) -> [f32; 2] {
        self.joints.map(|joint| joint.counts_per_rad)
    }

    /// Counts in one loop period that no movement explains, for both joints.
    pub(super) fn jump_limit_counts(&self) -> [i32; 2] {
        self.joints.map(|joint| joint.jump_limit_counts)
    }

    /// A computed-torque controller at rest at `position_rad`, with the model's f, friction and effects.
    pub(super) fn computed_torque(
        &self,
        model: &TorqueModel,
        [second, third]: &[JointCompensation; 2],
        position_rad: [f32; 2],
    ) -> ComputedTorque<f32> {
        ComputedTorque::with_effects(
            Arm { f: model.f, gravity_m_s2: self.gravity_m_s2 },
            self.drives(model),
            [&second.effects(), &third.effects()],
            self.computed_torque,
            self.loop_period_ns as f32 * 1.0e-9,
            position_rad,
        )
    }

    /// The drives with the model's friction.
    #[inline(always)]
    fn drives(&self, model: &TorqueModel) -> [Drive<f32>; 2] {
        Joint::ALL.map(|joint| Drive {
            viscous_friction_nm_s_per_rad: model.viscous_friction_nm_s_per_rad[joint.index()],
            coulomb_friction_nm: model.coulomb_friction_nm[joint.index()],
            ..self.joints[joint.index()].drive
        })
    }

    /// What the identification of a load needs to know.
    pub(super) fn load_setup(&self, model: &TorqueModel, settings: &LoadSettings, assumed: &Load<f32>) -> LoadSetup {
        LoadSetup {
            settings: *settings,
            f: model.f,
            gravity_m_s2: self.gravity_m_s2,
            drives: self.drives(model),
            a_per_code: self.joints.map(|joint| 1.0 / joint.dac_codes_per_a),
            offset_a: self.joints.map(|joint| joint.dac_offset_a),
            period_s: self.loop_period_ns as f32 * 1.0e-9,
            command_delay_s: (self.ahead_ns - self.loop_period_ns / 2) as f32 * 1.0e-9,
            assumed: *assumed,
        }
    }
}

/// A model in the board's precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TorqueModel {
    f: [f32; PARAMETERS],
    viscous_friction_nm_s_per_rad: [f32; 2],
    coulomb_friction_nm: [f32; 2],
}

impl TorqueModel {
    pub(super) fn new(model: &Model) -> Self {
        Self {
            f: model.f.map(|value| value as f32),
            viscous_friction_nm_s_per_rad: model.viscous_friction_nm_s_per_rad.map(|value| value as f32),
            coulomb_friction_nm: model.coulomb_friction_nm.map(|value| value as f32),
        }
    }
}
