//! Getting a board ready: robot constants, pose, model.

use std::time::Duration;

use shared::protocol::{
    Configuration, Mode, Model, ModelSlot, Refusal, Reply, Request, Status, StoreState, StoredParameters,
};

use super::{Client, ClientError};

/// How often to ask whether the board has stored its parameters.
const STORING_POLL: Duration = Duration::from_millis(10);
/// How long storing may take: an erasure of 4 s at worst, and the record.
const STORING_LIMIT: Duration = Duration::from_secs(6);

/// How the pose of the arm is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pose {
    /// The board must know it already.
    Known,
    /// The arm stands at these joint angles in rad now.
    Declared([f64; 2]),
    /// At these joint angles unless the board knows better: for a simulated arm, which starts there.
    DefaultsTo([f64; 2]),
}

/// Why a board could not be made ready.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The conversation failed.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The board is in a fault.
    #[error("the board is switched off by a fault: {0}; when its cause is gone, pass --clear-fault")]
    InFault(shared::protocol::Fault),
    /// The amplifiers are on.
    #[error("the board is {mode}; another program may be using it: stop that one first")]
    Busy {
        /// What it is doing.
        mode: &'static str,
    },
    /// The pose is not known.
    #[error(
        "the board does not know the pose of the arm: bring the arm to a known pose and pass it as --pose Q2,Q3 (joint \
         angles in rad)"
    )]
    PoseUnknown,
    /// What was read back is not what was sent.
    #[error(
        "the model read back from the board is not the one sent (CRC {read_back:08x}, sent {sent:08x}); upload it again"
    )]
    ReadBack {
        /// CRC of the model sent.
        sent: u32,
        /// CRC of the model read back.
        read_back: u32,
    },
}

/// Proof of a model upload.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelReceipt {
    /// The model, as read back from the board after it became active.
    pub active: Model,
    /// Its CRC-32.
    pub crc: u32,
    /// CRC-32 of the model that was active before, if any.
    pub replaced_crc: Option<u32>,
}

impl Client {
    /// What the board is doing.
    pub fn status(&mut self) -> Result<Status, ClientError> {
        match self.request(Request::Status)? {
            Reply::Status(status) => Ok(status),
            _ => Err(ClientError::Unexpected { request: "the question for its status" }),
        }
    }

    /// Makes sure the board is idle and has this configuration and a pose.
    pub fn prepare(
        &mut self,
        configuration: &Configuration,
        pose: Pose,
        clear_fault: bool,
    ) -> Result<Status, SessionError> {
        let mut status = self.status()?;
        if let Mode::Fault(fault) = status.mode {
            if !clear_fault {
                return Err(SessionError::InFault(fault));
            }
            self.command(Request::ClearFault)?;
            status = self.status()?;
        }
        if status.mode != Mode::Idle {
            return Err(SessionError::Busy { mode: status.mode.name() });
        }
        if status.configuration_crc != Some(configuration.crc()) {
            for part in configuration.parts() {
                self.command(Request::Configure(part))?;
            }
            self.command(Request::ApplyConfiguration { crc: configuration.crc() })?;
            // A new loop period takes effect at the next tick.
            self.wait(Duration::from_millis(2))?;
            status = self.status()?;
        }
        let declared = match pose {
            Pose::Declared(position_rad) => Some(position_rad),
            Pose::DefaultsTo(position_rad) if !status.pose_known => Some(position_rad),
            Pose::Known if !status.pose_known => return Err(SessionError::PoseUnknown),
            Pose::Known | Pose::DefaultsTo(_) => None,
        };
        if let Some(position_rad) = declared {
            self.command(Request::SetPosition { position_rad })?;
            status = self.status()?;
        }
        Ok(status)
    }

    /// Uploads a model in two phases and reads back what is active afterwards.
    pub fn upload(&mut self, model: &Model) -> Result<ModelReceipt, SessionError> {
        let crc = model.crc();
        let replaced_crc = self.status()?.active_model_crc;
        let staged = self.model_reply(Request::StageModel { model: *model, crc }, "staging the model")?;
        self.compare(model, staged)?;
        let staged = self.model_reply(Request::ReadModel(ModelSlot::Staged), "reading the model back")?;
        self.compare(model, staged)?;
        self.model_reply(Request::CommitModel { crc }, "activating the model")?;
        let active = self.model_reply(Request::ReadModel(ModelSlot::Active), "reading the model back")?;
        let active = self.compare(model, active)?;
        Ok(ModelReceipt { active, crc, replaced_crc })
    }

    /// Arms the board; where it is just storing parameters, as soon as that is done.
    pub fn arm(&mut self) -> Result<(), ClientError> {
        let until = self.now() + STORING_LIMIT;
        loop {
            match self.command(Request::Arm) {
                Err(ClientError::Refused { refusal: Refusal::Storing, .. }) if self.now() < until => {
                    self.wait(STORING_POLL)?;
                }
                result => return result,
            }
        }
    }

    /// Waits until the board has stored what is to be stored, and says what came of it. Still
    /// [`StoreState::Pending`] where it takes too long, which it does while the board is not idle.
    pub fn wait_until_stored(&mut self) -> Result<StoredParameters, ClientError> {
        let until = self.now() + STORING_LIMIT;
        loop {
            let stored = self.status()?.stored;
            if stored.state != StoreState::Pending || self.now() >= until {
                return Ok(stored);
            }
            self.wait(STORING_POLL)?;
        }
    }

    /// The model the board runs computed torque with, if any.
    pub fn active_model(&mut self) -> Result<Option<Model>, ClientError> {
        self.model_reply(Request::ReadModel(ModelSlot::Active), "reading the model back")
    }

    fn model_reply(&mut self, request: Request, name: &'static str) -> Result<Option<Model>, ClientError> {
        match self.request(request) {
            Ok(Reply::Model { model, .. }) => Ok(model),
            Ok(_) => Err(ClientError::Unexpected { request: name }),
            Err(ClientError::Refused { refusal: shared::protocol::Refusal::NoModel, .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// The model the board holds, if it is bit for bit the one sent.
    fn compare(&self, sent: &Model, held: Option<Model>) -> Result<Model, SessionError> {
        let read_back = held.as_ref().map_or(0, Model::crc);
        match held {
            Some(held) if read_back == sent.crc() => Ok(held),
            _ => Err(SessionError::ReadBack { sent: sent.crc(), read_back }),
        }
    }

    /// Lets time pass on the link's clock; what comes meanwhile is kept.
    pub(super) fn wait(&mut self, duration: Duration) -> Result<(), ClientError> {
        let until = self.now() + duration;
        while let Some(message) = self.read_message(until)? {
            if !matches!(message, shared::protocol::BoardMessage::Reply { .. }) {
                self.unasked.push_back(message);
            }
        }
        Ok(())
    }
}
