//! The real firmware image on an emulated microcontroller, with the simulated arm at its terminals.
//!
//! | module | its one job |
//! |---|---|
//! | [`nucleo`] | the board: clock, supply, and which pin carries what |
//! | `part`, `dac`, [`flash`] | the microcontroller, with models of the converter, the USB core and the flash memory that the emulator lacks |
//! | `wire` | the serial line |
//! | [`usb`] | the part's USB core, a cable, and a host that recognises the board |
//! | `arm` | currents in, encoder edges and measured currents out |
//! | `bench` | runs all of it in lock-step |
//! | `command`, `conversation`, `link` | the way from there to [`armid::client::Client`] |
//! | [`observations`], `checks` | what is watched from outside meanwhile, and what must always hold |
//! | [`probe`] | a debug probe on its SWD pins |
//! | [`control_time`] | how long the control interrupt took |
//! | [`damage`] | where in the image to hit |
//!
//! The image is the one that is flashed, byte for byte. It sees registers: timers that count encoder edges, converters,
//! a serial port with DMA, the watchdog. Time is virtual and passes only while the host waits for the board, so a run
//! depends on nothing but its inputs.
//!
//! What this does not show: wait states of the flash memory and instructions of several cycles (the emulated core is
//! set slower instead), anything analogue, the electrical side of USB, and every difference between the models and
//! silicon.

mod arm;
mod bench;
mod checks;
mod command;
pub mod control_time;
mod conversation;
mod dac;
pub mod damage;
pub mod flash;
mod link;
pub mod nucleo;
pub mod observations;
mod part;
pub mod probe;
pub mod usb;
mod wire;

use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;

use armid::hidden_robot::HiddenRobot;
use armid::link::MemoryFlash;
use armid::robot::Robot;
use rigless::emulator::{self, Host, Start};
use rigless::image::Image;
use rigless::session::Session;
use rigless::time::VirtualNanos;
use shared::arm::PARAMETERS;

use arm::SimulatedArm;
use bench::Bench;
use command::{Intervention, Until};
pub use command::{PowerCut, Turn};
use conversation::Conversation;
pub use link::EmulatedLink;
use nucleo::Nucleo;
use observations::Observations;
use probe::DebugProbe;
use usb::UsbAction;

use crate::line::Trouble;

/// Names the image to run.
pub const FIRMWARE_VARIABLE: &str = "ARMID_FIRMWARE";

/// How long a system takes at most until a board that was plugged in has its port.
const USB_APPEARS_WITHIN: Duration = Duration::from_secs(2);

/// The image that the environment names; nothing where it names none.
pub fn firmware_from_environment() -> Option<PathBuf> {
    std::env::var_os(FIRMWARE_VARIABLE).filter(|path| !path.is_empty()).map(PathBuf::from)
}

/// Names the command `armid`, which belongs to another package than the tests that run it on this board.
const COMMAND_VARIABLE: &str = "ARMID_COMMAND";

/// The image and the command that the environment names; nothing, and a word about it, where it does not name both.
pub fn image_and_command_from_environment() -> Option<(PathBuf, PathBuf)> {
    let named = firmware_from_environment().zip(std::env::var_os(COMMAND_VARIABLE).map(PathBuf::from));
    if named.is_none() {
        println!("SKIPPED: {FIRMWARE_VARIABLE} or {COMMAND_VARIABLE} is not set; run `tests/run emulated`");
    }
    named
}

/// Why an emulation did not start, or ended early.
#[derive(Debug, thiserror::Error)]
pub enum EmulationError {
    /// The image cannot be used.
    #[error("the image cannot be run: {0}")]
    Image(#[from] rigless::image::Error),
    /// The description of the part is wrong.
    #[error("the emulated part cannot be built: {0}")]
    Part(#[from] rigless::soc::Error),
    /// The emulator gave up.
    #[error("the emulator gave up: {0}")]
    Emulator(#[from] emulator::Error),
    /// A port of this computer for the debug probe cannot be had.
    #[error("no port can be had for the debug probe: {0}")]
    Probe(std::io::Error),
}

/// A board that runs the firmware image, in a thread of its own.
pub struct EmulatedBoard {
    conversation: Arc<Mutex<Conversation>>,
    thread: JoinHandle<Result<Observations, EmulationError>>,
    probe: Option<DebugProbe>,
}

impl EmulatedBoard {
    /// Switches on a board with the image at `firmware`, and `hidden` with the drives of `robot` at its terminals. The
    /// arm rests at zero angles: upper arm horizontal, forearm up. The board has no parameters, but a memory that takes
    /// some without being erased first.
    pub fn start(firmware: &Path, robot: &Robot, hidden: &HiddenRobot) -> Result<Self, EmulationError> {
        Self::start_with(firmware, robot, hidden, &MemoryFlash::default())
    }

    /// As [`Self::start`], with what `flash` holds.
    pub fn start_with(
        firmware: &Path,
        robot: &Robot,
        hidden: &HiddenRobot,
        flash: &MemoryFlash,
    ) -> Result<Self, EmulationError> {
        Self::start_on(firmware, robot, hidden, flash, None)
    }

    /// As [`Self::start_with`], with a debug probe on a port of this computer, 0 for any.
    pub fn start_with_probe(
        firmware: &Path,
        robot: &Robot,
        hidden: &HiddenRobot,
        flash: &MemoryFlash,
        port: u16,
    ) -> Result<Self, EmulationError> {
        let debugger = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).map_err(EmulationError::Probe)?;
        let address = debugger.local_addr().map_err(EmulationError::Probe)?;
        let mut board = Self::start_on(firmware, robot, hidden, flash, Some(debugger))?;
        board.probe = Some(DebugProbe::start(port, address).map_err(EmulationError::Probe)?);
        Ok(board)
    }

    fn start_on(
        firmware: &Path,
        robot: &Robot,
        hidden: &HiddenRobot,
        flash: &MemoryFlash,
        debugger: Option<TcpListener>,
    ) -> Result<Self, EmulationError> {
        let parameters = Image::new(Path::new("parameters"), flash.to_bytes(), Some(flash::PARAMETERS.start))?;
        let images = [Image::read(firmware, None)?, parameters];
        let session = Session::new(Box::new(Nucleo::new()?), 0, VirtualNanos(0))?;
        let (command_sender, commands) = mpsc::channel();
        let (answers, answer_receiver) = mpsc::channel();
        let bench = Bench::new(SimulatedArm::new(robot, hidden), commands, answers);
        let thread = std::thread::spawn(move || {
            let mut start = Start::new(&images);
            start.debugger = debugger.as_ref();
            let finished = emulator::run(session, &start, bench)?;
            let mut observations = finished.driver.into_observations();
            observations.complete(&finished.session);
            Ok(observations)
        });
        let conversation = Arc::new(Mutex::new(Conversation::new(command_sender, answer_receiver)));
        Ok(Self { conversation, thread, probe: None })
    }

    /// Its debug probe, if it was started with one.
    pub fn probe(&self) -> Option<&DebugProbe> {
        self.probe.as_ref()
    }

    /// Its serial line.
    pub fn link(&self) -> EmulatedLink {
        EmulatedLink::new(self.conversation.clone(), shared::protocol::Link::Serial)
    }

    /// Its USB port, opened by the first use that waits for it.
    pub fn usb_link(&self) -> EmulatedLink {
        self.plan_on_usb(Duration::ZERO, UsbAction::Open(true));
        let mut link = EmulatedLink::new(self.conversation.clone(), shared::protocol::Link::Usb);
        // Without a board at the other end, the first use says so.
        let _ = armid::link::Link::reopen(&mut link, USB_APPEARS_WITHIN);
        link
    }

    /// Lets something happen on USB so much later.
    pub fn plan_on_usb(&self, after: Duration, action: UsbAction) {
        self.with(|conversation| conversation.plan_on_usb(after, action));
    }

    /// Pulls the USB cable now and plugs it in again so much later.
    pub fn unplug_usb_for(&self, duration: Duration) {
        self.plan_on_usb(Duration::ZERO, UsbAction::Plug(false));
        self.plan_on_usb(duration, UsbAction::Plug(true));
    }

    /// The program at the USB port stops reading now and goes on so much later.
    pub fn stall_usb_for(&self, duration: Duration) {
        self.plan_on_usb(Duration::ZERO, UsbAction::Stall(true));
        self.plan_on_usb(duration, UsbAction::Stall(false));
    }

    /// The program at the serial line stops reading now and goes on so much later. What the system keeps for it meanwhile
    /// has an end.
    pub fn stall_serial_for(&self, duration: Duration) {
        self.with(|conversation| conversation.stall_serial(duration));
    }

    /// The board's time.
    pub fn now(&self) -> Duration {
        self.with(|conversation| conversation.now())
    }

    /// Lets the board run with nobody at the line.
    pub fn run(&self, duration: Duration) {
        // An emulation that has ended says why in `finish`.
        let _ = self.with(|conversation| conversation.run(duration, Until::TimeIsUp));
    }

    /// Presses or releases the emergency stop.
    pub fn set_emergency_stop(&self, pressed: bool) {
        self.with(|conversation| conversation.next().emergency_stop = pressed);
    }

    /// Puts the line in trouble for so long, in both directions.
    pub fn disturb_line(&self, trouble: Trouble, duration: Duration) {
        self.with(|conversation| {
            let until = conversation.now() + duration;
            conversation.next().trouble = Some((trouble, until.as_nanos() as u64));
        });
    }

    /// Turns a motor by hand, with the arm uncoupled, as time goes on.
    pub fn turn_by_hand(&self, turn: Turn) {
        self.with(|conversation| conversation.next().turn = Some(turn));
    }

    /// The arm carries something from now on that adds this to its f1..f9.
    pub fn carry(&self, added_f: [f64; PARAMETERS]) {
        self.with(|conversation| conversation.next().added_f = Some(added_f));
    }

    /// Does something to the chip itself, between two instructions, and returns what that gives. Panics when the
    /// emulation has ended.
    pub fn intervene<T: Send + 'static>(
        &self,
        deed: impl FnOnce(&mut Session<Nucleo>, &mut dyn Host, VirtualNanos) -> T + Send + 'static,
    ) -> T {
        let (sender, result) = mpsc::channel();
        self.with(|conversation| {
            // Before the first instant there is no answer to wait for.
            let duration = Duration::from_nanos(u64::from(conversation.now().is_zero()));
            conversation.next().intervention = Some(Intervention(Box::new(move |session, host, at| {
                // Nobody waits any more where the host's thread has gone.
                let _ = sender.send(deed(session, host, at));
            })));
            let _ = conversation.run(duration, Until::TimeIsUp);
        });
        result.recv().expect("an emulation that has not ended")
    }

    /// Cuts the power for a millisecond.
    pub fn cut_power(&self, when: PowerCut) {
        self.with(|conversation| conversation.cut_power(when));
    }

    /// Switches the board off and says what was watched.
    pub fn finish(mut self) -> Result<Observations, EmulationError> {
        // A core that it holds would not hear of the end.
        self.probe = None;
        self.with(Conversation::end);
        self.thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }

    fn with<T>(&self, act: impl FnOnce(&mut Conversation) -> T) -> T {
        act(&mut self.conversation.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
