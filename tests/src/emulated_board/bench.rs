//! Runs board and arm in lock-step, and hands over to the host in between.

use std::sync::mpsc::{Receiver, Sender};

use rigless::emulator::{Access, AccessKind, Driver, Host, Settled, Stop};
use rigless::session::Session;
use rigless::soc::stm32f427::generated::{DAC, GPIOF};
use rigless::time::VirtualNanos;
use shared::protocol::Link;

use super::arm::SimulatedArm;
use super::command::{Answer, Command, PowerCut, Turn, Until};
use super::flash::{Fate, FlashArray};
use super::nucleo::{Nucleo, Outputs};
use super::observations::{FlashUse, Observations, OutputChange, Tick};
use super::usb::UsbAction;
use crate::line::Trouble;

/// Ends every frame of the protocol, and occurs nowhere else.
const FRAME_END: u8 = 0;

/// Status and counter register of TIM1.
const TIM1_STATUS: u64 = 0x4001_0010;
const TIM1_COUNTER: u64 = 0x4001_0024;

/// How long the power stays away.
const POWER_CUT_NS: u64 = 1_000_000;

/// The emulator asks it at every stop what happens next. It waits for the host whenever nothing is left to run, so
/// virtual time passes only when the host waits, and two runs are the same.
#[derive(Debug)]
pub struct Bench {
    arm: SimulatedArm,
    commands: Receiver<Command>,
    answers: Sender<Answer>,
    command: Command,
    usb_actions: Vec<(u64, UsbAction)>,
    /// A motor that is being turned by hand, and when its next edge is due.
    turn: Option<(Turn, u64)>,
    /// Until when the serial port sees errors.
    serial_errors_until_ns: Option<u64>,
    outputs: Option<Outputs>,
    restarts_seen: usize,
    tick: Option<(Tick, u64)>,
    flash: FlashArray,
    /// Operations of the flash memory until power fails.
    operations_left: Option<u64>,
    power_returns_ns: Option<u64>,
    observations: Observations,
}

impl Bench {
    /// A bench that waits for its first command.
    pub fn new(arm: SimulatedArm, commands: Receiver<Command>, answers: Sender<Answer>) -> Self {
        Self {
            arm,
            commands,
            answers,
            command: Command::default(),
            usb_actions: Vec::new(),
            turn: None,
            serial_errors_until_ns: None,
            outputs: None,
            restarts_seen: 0,
            tick: None,
            flash: FlashArray::default(),
            operations_left: None,
            power_returns_ns: None,
            observations: Observations::default(),
        }
    }

    /// What was watched.
    pub fn into_observations(self) -> Observations {
        self.observations
    }

    /// Puts everything that comes from outside on the pins, which forget it at a reset.
    fn drive_pins(&mut self, board: &mut Nucleo, at: VirtualNanos) {
        board.set_emergency_stop(at, self.command.emergency_stop);
        board.set_current_codes(self.arm.current_codes());
        for joint in 0..2 {
            board.set_encoder(at, joint, self.arm.levels(joint));
        }
    }

    /// Lets the arm and its encoders catch up.
    fn advance_arm(&mut self, board: &mut Nucleo, at: VirtualNanos) {
        while let Some(edge) = self.arm.next_edge().filter(|edge| edge.at_ns <= at.0) {
            let levels = self.arm.pass(edge);
            board.set_encoder(at, edge.joint, levels);
            self.observations.edges[edge.joint] += 1;
        }
        if at.0 >= self.arm.ahead_ns() {
            self.arm.advance(at.0);
        }
        if let Some((mut turn, due_ns)) = self.turn.take().filter(|(turn, _)| turn.counts != 0) {
            let mut due_ns = due_ns;
            if due_ns <= at.0 {
                let levels = self.arm.turn_by_hand(turn.joint, turn.counts > 0);
                board.set_encoder(at, turn.joint, levels);
                turn.counts -= turn.counts.signum();
                due_ns += turn.interval_ns;
            }
            self.turn = Some((turn, due_ns));
        }
    }

    /// Lets the host have its turn as long as it wants no time to pass. False when it has gone.
    fn serve_host(&mut self, session: &mut Session<Nucleo>, at: VirtualNanos, host: &mut dyn Host) -> bool {
        loop {
            let board = session.board_mut();
            let usb = board.usb().host();
            let is_over = match self.command.until {
                Until::TimeIsUp => false,
                Until::Frame(Link::Serial) => {
                    board.wire().is_some_and(|wire| wire.received().last() == Some(&FRAME_END))
                }
                Until::Frame(Link::Usb) => !usb.is_open() || usb.received().last() == Some(&FRAME_END),
                Until::UsbIsOpen => usb.is_open(),
            };
            if at.0 < self.command.run_until_ns && !is_over {
                return true;
            }
            if at.0 > 0 {
                let from_board = board.wire().map(|wire| wire.take_received()).unwrap_or_default();
                let usb_is_open = board.usb().host().is_open();
                let from_usb = board.drive_usb(at, |usb, context| usb.drive(context, |host, _| host.take_received()));
                if self.answers.send(Answer { at_ns: at.0, from_board, from_usb, usb_is_open }).is_err() {
                    return false;
                }
            }
            let Ok(mut command) = self.commands.recv() else { return false };
            if let Some(wire) = board.wire() {
                wire.send(command.to_board.drain(..));
            }
            self.usb_actions.append(&mut command.usb_actions);
            self.act_on_usb(board, at);
            if !command.to_usb.is_empty() {
                board.drive_usb(at, |usb, context| {
                    usb.drive(context, |host, now_ns| host.send(now_ns, &command.to_usb))
                });
            }
            if command.emergency_stop != self.command.emergency_stop {
                board.set_emergency_stop(at, command.emergency_stop);
            }
            match command.power_cut.take() {
                Some(PowerCut::Now) => self.cut_power(board, at),
                Some(PowerCut::AfterFlashOperations(count)) => self.operations_left = Some(count),
                None => {}
            }
            if let Some(turn) = command.turn.take() {
                self.turn = Some((turn, at.0 + turn.interval_ns));
            }
            if let Some(added_f) = command.added_f.take() {
                self.arm.set_load(added_f);
            }
            if let Some((trouble, until_ns)) = command.trouble.take() {
                self.disturb(board, trouble, until_ns);
            }
            if let Some(intervention) = command.intervention.take() {
                (intervention.0)(session, host, at);
            }
            self.command = command;
        }
    }

    fn disturb(&mut self, board: &mut Nucleo, trouble: Trouble, until_ns: u64) {
        if let Trouble::Noise { per_million } = trouble {
            board.set_serial_errors(per_million);
            self.serial_errors_until_ns = Some(until_ns);
        }
        if let Some(wire) = board.wire() {
            wire.disturb(trouble, until_ns);
        }
    }

    /// Does what is due on USB.
    fn act_on_usb(&mut self, board: &mut Nucleo, at: VirtualNanos) {
        let (due, later) = self.usb_actions.iter().partition(|(at_ns, _)| *at_ns <= at.0);
        let due: Vec<(u64, UsbAction)> = due;
        self.usb_actions = later;
        for (_, action) in due {
            board.drive_usb(at, |usb, context| usb.act(action, context));
        }
    }

    fn cut_power(&mut self, board: &mut Nucleo, at: VirtualNanos) {
        self.flash.power_failed();
        self.operations_left = None;
        self.power_returns_ns = Some(at.0 + POWER_CUT_NS);
        board.set_power(at, false);
    }

    /// The firmware may have done something to the flash memory.
    fn watch_flash(&mut self, board: &mut Nucleo, host: &mut dyn Host, access: &Access) {
        if self.power_returns_ns.is_some() {
            return;
        }
        let left = self.operations_left;
        let at_ns = access.virtual_time.0;
        let fate = || if left == Some(0) { Fate::Torn(at_ns) } else { Fate::Whole };
        match self.flash.observe(board, host, access, fate) {
            None => {}
            Some(Err(fault)) => self.observations.flash_faults.push(fault),
            Some(Ok(operation)) => {
                let amplifiers_enabled = board.outputs().amplifiers_enabled;
                self.observations.flash_uses.push(FlashUse { at_ns, operation, amplifiers_enabled });
                self.operations_left = left.and_then(|left| left.checked_sub(1));
                if left == Some(0) {
                    self.cut_power(board, access.virtual_time);
                }
            }
        }
    }

    /// The board may have put something else out.
    fn watch_outputs(&mut self, board: &mut Nucleo, at: VirtualNanos) {
        let outputs = board.outputs();
        if self.outputs != Some(outputs) {
            self.outputs = Some(outputs);
            self.observations.outputs.push(OutputChange { at_ns: at.0, outputs });
            self.arm.apply(at.0, &outputs);
            board.set_current_codes(self.arm.current_codes());
        }
    }
}

impl Driver<Nucleo> for Bench {
    fn on_debugger_attached(&mut self, _at: VirtualNanos, _instruction_count: u64, attached: bool) {
        self.flash.set_probed(attached);
        self.observations.was_probed |= attached;
    }

    fn on_settled(&mut self, session: &mut Session<Nucleo>, host: &mut dyn Host, settled: Settled) {
        let Settled::Access { access, value } = settled else { return };
        self.watch_flash(session.board_mut(), host, &access);
        match (access.kind, access.address) {
            // The control interrupt reads the counter first and the status last; nothing else reads either.
            (AccessKind::Read, TIM1_COUNTER) => {
                let tick = Tick { start_ns: access.virtual_time.0, timer_steps: value, instructions: 0 };
                self.tick = Some((tick, access.instruction_count));
            }
            (AccessKind::Read, TIM1_STATUS) => {
                if let Some((mut tick, first_instruction)) = self.tick.take() {
                    tick.instructions = access.instruction_count - first_instruction;
                    self.observations.ticks.push(tick);
                }
            }
            (AccessKind::Write, address) if [DAC, GPIOF].iter().any(|block| holds(block, address)) => {
                self.watch_outputs(session.board_mut(), access.virtual_time);
            }
            _ => {}
        }
    }

    fn on_stop(&mut self, session: &mut Session<Nucleo>, stop: Stop, host: &mut dyn Host) -> Option<VirtualNanos> {
        let restarts = session.resets().len();
        let board = session.board_mut();
        if self.power_returns_ns.is_some_and(|returns_ns| stop.at.0 >= returns_ns) {
            self.power_returns_ns = None;
            board.set_power(stop.at, true);
        }
        if stop.at.0 == 0 || restarts != self.restarts_seen {
            self.restarts_seen = restarts;
            self.watch_outputs(board, stop.at);
            self.drive_pins(board, stop.at);
        }
        self.advance_arm(board, stop.at);
        board.set_current_codes(self.arm.current_codes());
        board.look_at_usb_pins(stop.at);
        self.act_on_usb(board, stop.at);
        if self.serial_errors_until_ns.is_some_and(|until_ns| until_ns <= stop.at.0) {
            self.serial_errors_until_ns = None;
            board.set_serial_errors(0);
        }
        if !self.serve_host(session, stop.at, host) {
            self.observations.end_ns = stop.at.0;
            self.observations.instructions = stop.instruction_count;
            self.observations.position_rad = self.arm.position_rad();
            if let Some(wire) = session.board_mut().wire() {
                self.observations.line_losses = wire.losses();
            }
            return None;
        }
        let edge_ns = self.arm.next_edge().map_or(u64::MAX, |edge| edge.at_ns);
        let action_ns = self.usb_actions.iter().map(|&(at_ns, _)| at_ns).min().unwrap_or(u64::MAX);
        let turn_ns = self.turn.map_or(u64::MAX, |(_, due_ns)| due_ns);
        let next_ns = self.arm.ahead_ns().min(edge_ns).min(turn_ns).min(action_ns).min(self.command.run_until_ns);
        Some(VirtualNanos(next_ns.max(stop.at.0 + 1)))
    }
}

fn holds(block: &rigless::soc::Peripheral, address: u64) -> bool {
    (block.base..block.base + block.size).contains(&address)
}
