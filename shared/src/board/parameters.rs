//! Configuration and models: staged, checked, and swapped whole.

use super::constants::{Constants, TorqueModel};
use super::findings::{Findings, ModelFindings};
use crate::protocol::{
    Configuration, ConfigurationPart, Joint, JointCompensation, JointConstants, LoopConstants, Model, ModelRange,
    ModelSlot, PartName, Refusal,
};
use crate::trajectory::MotionLimits;

/// A configuration that passed its check, with what follows from it.
#[derive(Clone, Debug)]
pub(super) struct Applied {
    pub(super) configuration: Configuration,
    pub(super) constants: Constants,
    pub(super) crc: u32,
    pub(super) robot_identity: u32,
}

impl Applied {
    fn new(configuration: &Configuration) -> Result<Self, Refusal> {
        configuration.check().map_err(Refusal::Configuration)?;
        Ok(Self {
            configuration: *configuration,
            constants: Constants::new(configuration),
            crc: configuration.crc(),
            robot_identity: configuration.robot_identity(),
        })
    }
}

/// A model that passed its check, with what follows from it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    pub(super) model: Model,
    pub(super) crc: u32,
    pub(super) torque_model: TorqueModel,
    /// Whether the pose is still the one that the model was uploaded at, so that phases that count from it hold.
    phases_hold: bool,
}

impl Held {
    /// What to compensate now.
    pub(super) fn compensation(&self) -> [JointCompensation; 2] {
        let mut compensation = self.model.compensation;
        if !self.phases_hold {
            compensation.iter_mut().for_each(JointCompensation::forget_phases);
        }
        compensation
    }
}

/// What a change of configuration makes invalid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    /// It was the same.
    Nothing,
    /// Limits or gains: a trajectory has to be checked again.
    Limits,
    /// It is another robot: the pose is unknown too.
    Robot,
}

/// The parts received so far.
#[derive(Clone, Copy, Debug)]
struct Parts {
    second: Option<JointConstants>,
    third: Option<JointConstants>,
    common: Option<LoopConstants>,
    motion_limits: Option<MotionLimits>,
    model_range: Option<ModelRange>,
}

/// Configuration and models.
#[derive(Clone, Debug)]
pub(super) struct Parameters {
    parts: Parts,
    pub(super) applied: Option<Applied>,
    staged: Option<Held>,
    active: Option<Held>,
}

impl Parameters {
    pub(super) const fn new() -> Self {
        let parts = Parts { second: None, third: None, common: None, motion_limits: None, model_range: None };
        Self { parts, applied: None, staged: None, active: None }
    }

    /// Keeps a part until the configuration is applied; a part sent twice counts the last time.
    pub(super) fn stage_part(&mut self, part: &ConfigurationPart) {
        match *part {
            ConfigurationPart::Joint(Joint::Second, constants) => self.parts.second = Some(constants),
            ConfigurationPart::Joint(Joint::Third, constants) => self.parts.third = Some(constants),
            ConfigurationPart::Common(common) => self.parts.common = Some(common),
            ConfigurationPart::MotionLimits(limits) => self.parts.motion_limits = Some(limits),
            ConfigurationPart::ModelRange(range) => self.parts.model_range = Some(range),
        }
    }

    /// Applies the staged parts, if they are all there, are those meant, and are acceptable.
    #[inline]
    pub(super) fn apply_parts(&mut self, crc: u32) -> Result<Change, Refusal> {
        let missing = |part| Refusal::MissingPart { part };
        let parts = &self.parts;
        let configuration = Configuration {
            joints: [
                parts.second.ok_or(missing(PartName::Joint(Joint::Second)))?,
                parts.third.ok_or(missing(PartName::Joint(Joint::Third)))?,
            ],
            common: parts.common.ok_or(missing(PartName::Common))?,
            motion_limits: parts.motion_limits.ok_or(missing(PartName::MotionLimits))?,
            model_range: parts.model_range.ok_or(missing(PartName::ModelRange))?,
        };
        let board = configuration.crc();
        if board != crc {
            return Err(Refusal::CrcMismatch { host: crc, board });
        }
        self.apply(&configuration)
    }

    /// Applies a configuration; models it no longer allows are forgotten.
    #[inline]
    pub(super) fn apply(&mut self, configuration: &Configuration) -> Result<Change, Refusal> {
        let new = Applied::new(configuration)?;
        let change = match &self.applied {
            Some(old) if old.crc == new.crc => return Ok(Change::Nothing),
            Some(old) if old.robot_identity == new.robot_identity => Change::Limits,
            _ => Change::Robot,
        };
        let allowed = |held: &Held| held.model.check(new.robot_identity, &new.configuration.model_range).is_ok();
        self.staged = self.staged.filter(allowed);
        self.active = self.active.filter(allowed);
        self.applied = Some(new);
        Ok(change)
    }

    /// What is applied, or the refusal where nothing is.
    pub(super) fn applied(&self) -> Result<&Applied, Refusal> {
        self.applied.as_ref().ok_or(Refusal::NotConfigured)
    }

    /// First phase: keeps a model beside the active one, if it arrived as it was sent and is acceptable.
    pub(super) fn stage_model(&mut self, model: &Model, crc: u32, findings: &Findings) -> Result<(), Refusal> {
        let applied = self.applied()?;
        let examined_now;
        let findings = match findings.model() {
            Some(findings) => findings,
            None => {
                examined_now = ModelFindings::of(model);
                &examined_now
            }
        };
        if findings.crc != crc {
            return Err(Refusal::CrcMismatch { host: crc, board: findings.crc });
        }
        model.check_ranges(applied.robot_identity, &applied.configuration.model_range).map_err(Refusal::Model)?;
        findings.dynamics.map_err(Refusal::Model)?;
        self.staged = Some(Held { model: *model, crc, torque_model: findings.torque_model, phases_hold: true });
        Ok(())
    }

    /// Second phase: the staged model becomes the active one, in one assignment. It also stays staged, so a commit
    /// that is repeated has the same effect.
    pub(super) fn commit_model(&mut self, crc: u32) -> Result<(), Refusal> {
        let staged = self.staged.as_ref().ok_or(Refusal::NoModel)?;
        if staged.crc != crc {
            return Err(Refusal::CrcMismatch { host: crc, board: staged.crc });
        }
        self.active = self.staged;
        Ok(())
    }

    /// The pose is declared: ripple and cogging of models held before count from another angle now, and are left out
    /// until the model is uploaded again. The models themselves stay what they are.
    pub(super) fn pose_declared(&mut self) {
        for held in [&mut self.staged, &mut self.active].into_iter().flatten() {
            held.phases_hold = false;
        }
    }

    /// The model in a slot.
    pub(super) fn model(&self, slot: ModelSlot) -> Option<&Held> {
        match slot {
            ModelSlot::Staged => self.staged.as_ref(),
            ModelSlot::Active => self.active.as_ref(),
        }
    }
}
