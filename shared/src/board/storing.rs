//! When to store parameters, and what is known to be stored.

use super::parameters::Parameters;
use crate::protocol::{Model, ModelSlot, StoreFailure, StoreState, StoredParameters};
use crate::storage::{Found, Parameters as Stored};

/// What tells parameters apart: CRCs of configuration and model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Crcs {
    configuration: Option<u32>,
    model: Option<u32>,
}

impl Crcs {
    const NONE: Self = Self { configuration: None, model: None };
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wish {
    /// Store what is active, if it is not what is stored.
    Keep,
    /// Store that there is nothing.
    Forget,
}

/// Whether parameters are to be stored, are being stored, are stored.
#[derive(Clone, Debug)]
pub(super) struct Storing {
    wish: Option<Wish>,
    /// What is being written.
    writing: Option<Crcs>,
    stored: Crcs,
    failure: Option<StoreFailure>,
    damaged_records: u8,
}

impl Storing {
    pub(super) const fn new() -> Self {
        Self { wish: None, writing: None, stored: Crcs::NONE, failure: None, damaged_records: 0 }
    }

    /// Takes in what was found at the start, and whether the board accepted it.
    pub(super) fn restored(&mut self, found: &Found, accepted: bool) {
        self.damaged_records = found.damaged_records;
        match &found.parameters {
            Ok(Some(stored)) => {
                let model = stored.model.as_ref().map(Model::crc);
                self.stored = Crcs { configuration: Some(stored.configuration.crc()), model };
                self.failure = (!accepted).then_some(StoreFailure::Refused);
            }
            Ok(None) => {}
            Err(failure) => self.failure = Some(*failure),
        }
        if !found.sealed && self.failure.is_none() {
            // Power was cut from the end of it: once more, or it may be gone another time.
            self.wish = Some(if self.stored == Crcs::NONE { Wish::Forget } else { Wish::Keep });
            self.stored = Crcs::NONE;
        }
    }

    /// Active parameters were set, new or once more; whether they have to be stored is seen later.
    pub(super) fn keep(&mut self) {
        self.wish = Some(Wish::Keep);
    }

    /// What is stored is not to come back after a restart.
    pub(super) fn forget(&mut self) {
        self.wish = Some(Wish::Forget);
    }

    /// What to write now, if anything.
    pub(super) fn begin(&mut self, parameters: &Parameters) -> Option<Option<Stored>> {
        if self.writing.is_some() {
            return None;
        }
        let wish = self.wish.take()?;
        let active = parameters.applied.as_ref().filter(|_| wish == Wish::Keep);
        let model = parameters.model(ModelSlot::Active).filter(|_| active.is_some());
        let crcs = Crcs { configuration: active.map(|applied| applied.crc), model: model.map(|held| held.crc) };
        if crcs == self.stored && self.failure.is_none() && wish == Wish::Keep {
            return None;
        }
        self.writing = Some(crcs);
        Some(active.map(|applied| Stored { configuration: applied.configuration, model: model.map(|held| held.model) }))
    }

    pub(super) fn end(&mut self, result: Result<(), StoreFailure>) {
        let Some(crcs) = self.writing.take() else { return };
        match result {
            Ok(()) => {
                self.stored = crcs;
                self.failure = None;
                self.damaged_records = 0;
            }
            Err(failure) => self.failure = Some(failure),
        }
    }

    pub(super) fn is_writing(&self) -> bool {
        self.writing.is_some()
    }

    pub(super) fn stored(&self) -> StoredParameters {
        let state = match self.failure {
            _ if self.is_writing() || self.wish.is_some() => StoreState::Pending,
            Some(failure) => StoreState::Failed(failure),
            None if self.stored == Crcs::NONE => StoreState::Nothing,
            None => StoreState::Stored,
        };
        let Self { stored, damaged_records, .. } = *self;
        StoredParameters { state, configuration_crc: stored.configuration, model_crc: stored.model, damaged_records }
    }
}
