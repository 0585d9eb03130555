//! Running one movement on a board and turning it into a recording: what record, track, simulate and demo share.

use std::path::PathBuf;

use armid::capture::{self, Circumstances};
use armid::client::{Client, Movement, MovementPlan, MovementWatcher, Unwatched};
use armid::journal::Journal;
use armid::recording::{Mode, Recording};
use armid::robot::Robot;
use shared::load::LoadNews;
use shared::protocol::{ControlLaw, Info, LimitsActive, Request, Sample};

use super::common::{Prepared, advise};
use super::interrupt::Writing;
use super::{CommandError, interrupt, progress, wording};

/// A movement to run.
pub struct Run<'a> {
    pub robot: &'a Robot,
    pub movement: &'a Prepared,
    pub mode: Mode,
    pub seed: Option<u64>,
    /// Where the recording will go.
    pub path: PathBuf,
}

impl<'a> Run<'a> {
    /// Loads, runs and reads the movement; tells on stderr about rows lost and limits that acted.
    ///
    /// A movement that ended early still gives its recording, marked as partial.
    pub fn on(&self, client: &mut Client) -> Result<Ran<'a>, CommandError> {
        self.watched(client, &mut Unwatched)
    }

    /// [`Self::on`] with somebody looking on.
    pub fn watched(&self, client: &mut Client, watcher: &mut dyn MovementWatcher) -> Result<Ran<'a>, CommandError> {
        self.run(client, watcher, None)
    }

    /// [`Self::on`], every row on disk beside the recording to be as soon as it comes, so that not even a killed program
    /// loses it.
    pub fn recorded(&self, client: &mut Client, watcher: &mut dyn MovementWatcher) -> Result<Ran<'a>, CommandError> {
        if armid::is_stream(&self.path) {
            return self.watched(client, watcher);
        }
        let board = client.info().clone();
        let journal = Journal::begin(&self.path, self.circumstances(&board))?;
        self.run(client, watcher, Some(journal))
    }

    fn run(
        &self,
        client: &mut Client,
        watcher: &mut dyn MovementWatcher,
        mut journal: Option<Journal<'a>>,
    ) -> Result<Ran<'a>, CommandError> {
        interrupt::check()?;
        client.load_trajectory(&self.movement.trajectory)?;
        let law = match self.mode {
            Mode::P => ControlLaw::Position,
            Mode::Ctc => ControlLaw::ComputedTorque,
        };
        let plan = MovementPlan { law, settle_ns: self.movement.settle_ns };
        let mut show = progress::of_movement(&self.movement.name);
        client.end_movements_on(interrupt::watch(&CTRL_C));
        let mut both = Journaled { journal: journal.as_mut(), watcher };
        let movement = client.run_watched(&plan, &mut show, &mut both);
        let writing = interrupt::writing();
        let movement = movement?;
        report(&movement);
        if let Some(error) = journal.as_ref().and_then(Journal::failure) {
            advise(format!("the rows were not kept on disk as they came: {error}"));
        }
        let board = client.info().clone();
        let recording = capture::recording(&movement, &self.circumstances(&board), self.path.clone());
        // What is still in the memory of a simulated board ends with this process.
        let reread_from = Some(client.address()).filter(|address| address != SIMULATED);
        Ok(Ran { recording, board_lost: movement.recording.is_none(), reread_from, journal, _writing: writing })
    }

    fn circumstances(&self, board: &Info) -> Circumstances<'a> {
        Circumstances {
            robot: self.robot,
            mode: self.mode,
            trajectory: self.movement.name.clone(),
            board: board.clone(),
            seed: self.seed,
        }
    }
}

/// A journal beside whoever looks on.
struct Journaled<'a, 'b> {
    journal: Option<&'a mut Journal<'b>>,
    watcher: &'a mut dyn MovementWatcher,
}

impl MovementWatcher for Journaled<'_, '_> {
    fn row(&mut self, sample: &Sample) -> Option<Request> {
        if let Some(journal) = &mut self.journal {
            journal.push(sample);
        }
        self.watcher.row(sample)
    }

    fn load(&mut self, tick: u64, news: &LoadNews) {
        self.watcher.load(tick, news);
    }
}

/// What the first and the second Ctrl-C do during a movement.
const CTRL_C: [&str; 2] = [
    "stopping along the path; press Ctrl-C again to switch off at once",
    "switching off; press Ctrl-C again to end without the recording",
];

/// Address of a simulated board.
const SIMULATED: &str = "sim";

/// What running a movement brought.
pub struct Ran<'a> {
    /// The recording, not yet written.
    pub recording: Recording,
    /// The board went away before the end.
    board_lost: bool,
    /// The board that still has it in its memory, if there is one.
    reread_from: Option<String>,
    /// Its rows as they came, on disk until it is written itself.
    journal: Option<Journal<'a>>,
    /// Ctrl-C waits for it.
    _writing: Writing,
}

impl Ran<'_> {
    /// Why the recording is only part of its movement, if it is.
    pub fn partial(&self) -> Option<&str> {
        self.recording.manifest.as_ref()?.partial.as_deref()
    }

    /// Writes the recording; one without a row is left out. Where that fails, tells how to get at the rows again.
    pub fn write(&mut self, robot: &Robot) -> Result<(), CommandError> {
        if self.recording.samples() > 0 {
            self.write_rows(robot)?;
        }
        if let Some(journal) = self.journal.take() {
            journal.remove();
        }
        Ok(())
    }

    fn write_rows(&self, robot: &Robot) -> Result<(), CommandError> {
        self.recording.write(&self.recording.path, robot).map_err(|error| {
            if let Some(address) = &self.reread_from {
                advise(format!(
                    "the board at {address} keeps the recording until its next movement or reset; make room, then read it \
                     again with `armid record --last --out FILE` and the same --board and --robot"
                ));
            }
            error.into()
        })
    }

    /// The recording; an error where the movement did not come to its end.
    pub fn whole(self) -> Result<Recording, CommandError> {
        match self.partial() {
            None => Ok(self.recording),
            Some(reason) => Err(CommandError::Incomplete { reason: reason.to_string(), board_lost: self.board_lost }),
        }
    }
}

fn report(movement: &Movement) {
    if movement.reread_rows > 0 {
        advise(format!("{} rows were lost on the way and read from the board's memory", movement.reread_rows));
    }
    if movement.differing_rows > 0 {
        advise(format!(
            "{} rows came differently over the stream than they stand in the board's memory; the memory's are used",
            movement.differing_rows
        ));
    }
    let limits = movement.recording.map_or_else(LimitsActive::default, |recording| recording.limits_active);
    for limit in limits.iter() {
        advise(format!("a limit acted during the movement: {}", wording::in_its_words(limit.name())));
    }
}
