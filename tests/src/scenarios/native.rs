//! The simulated board of the host tool as a board under test.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::time::Duration;

use armid::hidden_robot::HiddenRobot;
use armid::link::{FlashHistory, Link, LinkError, SimulatedBoard};
use armid::robot::Robot;
use rigless::device::ResetCause;
use shared::arm::Load;
use shared::protocol::Link as BoardLink;
use shared::storage::Sector;

use super::{BoardUnderTest, Setup};
use crate::emulated_board::flash::{FlashOperation, PARAMETERS};
use crate::emulated_board::nucleo::Outputs;
use crate::emulated_board::observations::{FlashUse, Observations, OutputChange, Restart, Tick};
use crate::emulated_board::{PowerCut, Turn};
use crate::line::{Line, Trouble};

/// Seed of the sensors' noise, and of the line's.
const NOISE_SEED: u64 = 1;

/// A simulated board, watched tick by tick.
pub struct NativeBoard(Rc<RefCell<Watched>>);

struct Watched {
    board: SimulatedBoard,
    /// The line in both directions: to the board, from the board.
    lines: [Line; 2],
    from_board: VecDeque<u8>,
    /// A motor that is being turned by hand, and since when.
    turn: Option<(Turn, u64)>,
    /// Until when nobody takes what the board sends.
    stalled_until_ns: u64,
    /// What was done to its flash memory so far.
    flash: FlashHistory,
    observations: Observations,
}

impl NativeBoard {
    /// Switches on a board with `hidden` and the drives of `robot`.
    pub fn start(robot: &Robot, hidden: HiddenRobot) -> Self {
        Self::watch(SimulatedBoard::new(robot, hidden, NOISE_SEED))
    }

    /// As [`Self::start`], with all of a setup.
    pub fn with_setup(setup: &Setup) -> Self {
        let board = SimulatedBoard::new(&setup.robot, setup.hidden(), NOISE_SEED);
        Self::watch(board.with_flash(setup.flash.clone()))
    }

    fn watch(board: SimulatedBoard) -> Self {
        let flash = board.flash().history();
        Self(Rc::new(RefCell::new(Watched {
            board,
            lines: [Line::new(NOISE_SEED), Line::new(NOISE_SEED + 1)],
            from_board: VecDeque::new(),
            turn: None,
            stalled_until_ns: 0,
            flash,
            observations: Observations::default(),
        })))
    }
}

impl Watched {
    fn now_ns(&self) -> u64 {
        self.board.now().as_nanos() as u64
    }

    /// One tick, or none if the board has something to say already.
    fn step(&mut self) {
        self.turn_on();
        let from_ns = self.now_ns();
        if from_ns < self.stalled_until_ns {
            self.board.run(Duration::from_nanos(1));
            self.watch(from_ns);
            return;
        }
        let mut buffer = [0; 4096];
        let waited = self.board.receive(&mut buffer, Duration::from_nanos(1));
        let count = waited.expect("a link within this process");
        self.watch(from_ns);
        let now_ns = self.now_ns();
        for &byte in &buffer[..count] {
            self.from_board.extend(self.lines[1].carry(now_ns, byte));
        }
    }

    /// Edges that are due since the last tick.
    fn turn_on(&mut self) {
        let Some((mut turn, since_ns)) = self.turn.take().filter(|(turn, _)| turn.counts != 0) else { return };
        let due = (self.now_ns() - since_ns) / turn.interval_ns;
        let counts = turn.counts.signum() * (due as i32).min(turn.counts.abs());
        let mut both = [0; 2];
        both[turn.joint] = counts;
        self.board.count_on(both);
        turn.counts -= counts;
        self.turn = Some((turn, since_ns + due * turn.interval_ns));
    }

    /// Looks at what happened since `from_ns`: nothing, or one tick.
    fn watch(&mut self, from_ns: u64) {
        let now_ns = self.now_ns();
        if now_ns > from_ns {
            // It takes none of the board's time.
            self.observations.ticks.push(Tick { start_ns: from_ns, timer_steps: 0, instructions: 0 });
        }
        if self.board.restarts() > self.observations.restarts.len() {
            self.observations.restarts.push(Restart { at_ns: now_ns, cause: ResetCause::PowerOn });
            self.from_board.clear();
        }
        self.watch_flash();
        let (command_code, amplifiers_enabled) = self.board.outputs();
        let outputs = Outputs { command_code: command_code.map(Some), amplifiers_enabled };
        let seen = &mut self.observations.outputs;
        if seen.last().is_none_or(|last| last.outputs != outputs) {
            seen.push(OutputChange { at_ns: now_ns, outputs });
        }
    }

    /// Which words were programmed is not told; each stands for its sector.
    fn watch_flash(&mut self) {
        let history = self.board.flash().history();
        if history == self.flash {
            return;
        }
        let (_, amplifiers_enabled) = self.board.outputs();
        let at_ns = self.now_ns();
        for sector in Sector::BOTH.map(Sector::index) {
            let address = PARAMETERS.start + sector as u64 * (PARAMETERS.end - PARAMETERS.start) / 2;
            let erased = history.erased[sector] - self.flash.erased[sector];
            let programmed = history.programmed[sector] - self.flash.programmed[sector];
            let erasures = std::iter::repeat_n(FlashOperation::Erase { address }, erased);
            let all = erasures.chain(std::iter::repeat_n(FlashOperation::Program { address }, programmed));
            self.observations.flash_uses.extend(all.map(|operation| FlashUse { at_ns, operation, amplifiers_enabled }));
        }
        if history.misuses > self.flash.misuses {
            self.observations.flash_faults.push(format!("misused at {at_ns} ns"));
        }
        self.flash = history;
    }
}

/// A connection to a [`NativeBoard`].
struct NativeLink(Rc<RefCell<Watched>>);

impl Link for NativeLink {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        let mut watched = self.0.borrow_mut();
        let now_ns = watched.now_ns();
        let arrived: Vec<u8> = bytes.iter().filter_map(|&byte| watched.lines[0].carry(now_ns, byte)).collect();
        watched.board.send(&arrived)?;
        watched.watch(now_ns);
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        let mut watched = self.0.borrow_mut();
        let until = watched.board.now() + timeout;
        while watched.from_board.is_empty() && watched.board.now() < until {
            watched.step();
        }
        let count = buffer.len().min(watched.from_board.len());
        for (slot, byte) in buffer.iter_mut().zip(watched.from_board.drain(..count)) {
            *slot = byte;
        }
        Ok(count)
    }

    fn now(&self) -> Duration {
        self.0.borrow().board.now()
    }

    fn name(&self) -> String {
        self.0.borrow().board.name()
    }
}

impl BoardUnderTest for NativeBoard {
    const LINK: BoardLink = BoardLink::Usb;

    fn link(&self) -> Box<dyn Link> {
        Box::new(NativeLink(self.0.clone()))
    }

    fn now(&self) -> Duration {
        self.0.borrow().board.now()
    }

    fn run(&self, duration: Duration) {
        let mut watched = self.0.borrow_mut();
        let until = watched.board.now() + duration;
        while watched.board.now() < until {
            watched.step();
        }
    }

    fn set_emergency_stop(&self, pressed: bool) {
        self.0.borrow_mut().board.set_emergency_stop(pressed);
    }

    fn disturb_line(&self, trouble: Trouble, duration: Duration) {
        let mut watched = self.0.borrow_mut();
        let until_ns = (watched.board.now() + duration).as_nanos() as u64;
        for line in &mut watched.lines {
            line.disturb(trouble, until_ns);
        }
    }

    fn stall_reader(&self, duration: Duration) {
        let mut watched = self.0.borrow_mut();
        watched.stalled_until_ns = (watched.board.now() + duration).as_nanos() as u64;
    }

    fn delay_a_tick(&self) {
        self.0.borrow_mut().board.miss_deadline();
    }

    fn cut_power(&self, when: PowerCut) {
        let mut watched = self.0.borrow_mut();
        match when {
            PowerCut::Now => {
                watched.board.cut_power();
                let now_ns = watched.now_ns();
                watched.watch(now_ns);
            }
            PowerCut::AfterFlashOperations(operations) => {
                watched.board.flash().cut_power_after(operations as usize);
            }
        }
    }

    fn turn_by_hand(&self, turn: Turn) {
        let mut watched = self.0.borrow_mut();
        let now_ns = watched.now_ns();
        watched.turn = Some((turn, now_ns));
    }

    fn carry(&self, load: &Load<f64>) {
        self.0.borrow_mut().board.carry(load);
    }

    fn set_counters(&self, counts: [u32; 2]) {
        // Nothing has moved, so they stand at zero.
        self.0.borrow_mut().board.count_on(counts.map(u32::cast_signed));
    }

    fn finish(self) -> Observations {
        let watched = self.0.borrow();
        let mut observations = watched.observations.clone();
        observations.line_losses = [watched.lines[0].losses(), watched.lines[1].losses()];
        observations.end_ns = watched.now_ns();
        observations.check_always();
        observations
    }
}
