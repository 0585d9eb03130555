//! What can go wrong in a command, and the exit code that says so.

use armid::board_setup::SetupError;
use armid::calibrate::CalibrateError;
use armid::client::{AskedBy, ClientError, SessionError};
use armid::effects::EffectError;
use armid::excite::ExciteError;
use armid::file_error::FileError;
use armid::identify::IdentifyError;
use armid::link::LinkError;
use armid::margins::MarginError;
use shared::trajectory::LimitError;

use super::wording;

/// Why a command ended without its result.
#[derive(Debug, thiserror::Error)]
pub enum CommandError {
    /// A file.
    #[error(transparent)]
    File(#[from] FileError),
    /// A robot file that is to explain recordings; nothing is about to move, so that none of its faults is unsafe.
    #[error(transparent)]
    Repeating(FileError),
    /// The robot cannot run on a board.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The movement breaks a limit.
    #[error("the movement was not started: {0}")]
    Limit(LimitError),
    /// The paper's movement does not fit the robot.
    #[error(
        "the movement was not started: {0}. It is the paper's, for its own robot: `armid excite --robot FILE --out m.toml` \
         designs one for this robot, which --trajectory m.toml takes"
    )]
    PaperMovement(LimitError),
    /// Computed torque that would be too near to instability.
    #[error("{0}; nothing was moved")]
    Margin(#[from] MarginError),
    /// The board.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// An effect that cannot be.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// A calibration.
    #[error(transparent)]
    Calibrate(#[from] CalibrateError),
    /// An identification.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// A movement to design.
    #[error(transparent)]
    Excite(ExciteError),
    /// An explanation.
    #[error(transparent)]
    Explain(#[from] armid::explain::ExplainError),
    /// A movement that did not come to its end.
    #[error("the movement did not come to its end: {reason}")]
    Incomplete {
        /// Why, as the recording's manifest has it: with the names of the joints.
        reason: String,
        /// The board went away.
        board_lost: bool,
    },
    /// The firmware image.
    #[cfg(feature = "flash")]
    #[error(transparent)]
    Image(#[from] armid::firmware_image::ImageError),
    /// The debug probe.
    #[cfg(feature = "flash")]
    #[error(transparent)]
    Probe(#[from] super::flash::ProbeError),
    /// A result that is not good enough.
    #[error("{0}")]
    Failed(String),
    /// Arguments that do not go together.
    #[error("{0}; see --help")]
    Usage(String),
    /// The end was asked for.
    #[error("ended by {}: nothing more was moved", .0.name())]
    Interrupted(AskedBy),
    /// Standard output is closed.
    #[error("the result could not be written: {0}")]
    Output(std::io::Error),
}

impl CommandError {
    /// What to tell: where the joints are those of the board, by their names.
    pub fn message(&self) -> String {
        let text = self.to_string();
        let by_the_board = matches!(
            self,
            Self::Limit(_)
                | Self::PaperMovement(_)
                | Self::Excite(ExciteError::Limits(_))
                | Self::Session(
                    SessionError::InFault(_)
                        | SessionError::Client(ClientError::Refused { .. } | ClientError::Fault(_))
                )
        );
        if by_the_board { wording::in_its_words(&text) } else { text }
    }

    /// The documented exit code.
    pub fn exit_code(&self) -> u8 {
        const FAILED: u8 = 1;
        const USAGE: u8 = 2;
        const BAD_FILE: u8 = 3;
        const UNREACHABLE: u8 = 4;
        const UNSAFE: u8 = 5;
        match self {
            Self::File(error) if error.is_unsafe() => UNSAFE,
            Self::File(error) if error.is_about_output() => FAILED,
            Self::File(_) | Self::Repeating(_) => BAD_FILE,
            // What the recordings lack no other command line would bring.
            Self::Identify(
                IdentifyError::TooShort { .. } | IdentifyError::NoMotion { .. } | IdentifyError::NothingSound { .. },
            ) => BAD_FILE,
            Self::Identify(IdentifyError::NoFilter | IdentifyError::Filter { .. }) => USAGE,
            Self::Explain(armid::explain::ExplainError::Recordings(
                IdentifyError::TooShort { .. } | IdentifyError::NoMotion { .. },
            )) => BAD_FILE,
            Self::Explain(
                armid::explain::ExplainError::Audit(_) | armid::explain::ExplainError::UnknownEffect { .. },
            ) => BAD_FILE,
            Self::Setup(SetupError::Unstable(_)) | Self::Limit(_) | Self::PaperMovement(_) | Self::Margin(_) => UNSAFE,
            Self::Excite(ExciteError::Setting { .. }) => USAGE,
            Self::Excite(_) => UNSAFE,
            Self::Setup(_) => BAD_FILE,
            Self::Session(error) => match error {
                SessionError::Client(error) => match error {
                    // There are boards; which is meant the command line must say.
                    ClientError::Link(LinkError::SeveralBoards { .. }) => USAGE,
                    ClientError::Link(_) | ClientError::NoAnswer { .. } | ClientError::WrongVersion { .. } => {
                        UNREACHABLE
                    }
                    ClientError::Refused { .. } => UNSAFE,
                    ClientError::Unexpected { .. } | ClientError::Fault(_) | ClientError::Encode(_) => FAILED,
                },
                SessionError::InFault(_) | SessionError::PoseUnknown | SessionError::Busy { .. } => UNSAFE,
                SessionError::ReadBack { .. } => FAILED,
            },
            #[cfg(feature = "flash")]
            Self::Image(_) => BAD_FILE,
            #[cfg(feature = "flash")]
            Self::Probe(error) => match error {
                super::flash::ProbeError::Several { .. } => USAGE,
                super::flash::ProbeError::Flash { .. } => FAILED,
                _ => UNREACHABLE,
            },
            Self::Interrupted(by) => by.exit_code(),
            Self::Incomplete { board_lost: true, .. } => UNREACHABLE,
            Self::Calibrate(_)
            | Self::Identify(_)
            | Self::Explain(_)
            | Self::Incomplete { .. }
            | Self::Failed(_)
            | Self::Output(_) => FAILED,
            Self::Usage(_) | Self::Effect(_) => USAGE,
        }
    }
}

impl From<ExciteError> for CommandError {
    fn from(error: ExciteError) -> Self {
        match error {
            ExciteError::Setup(error) => Self::Setup(error),
            error => Self::Excite(error),
        }
    }
}

impl From<ClientError> for CommandError {
    fn from(error: ClientError) -> Self {
        Self::Session(error.into())
    }
}

impl From<LinkError> for CommandError {
    fn from(error: LinkError) -> Self {
        ClientError::from(error).into()
    }
}
