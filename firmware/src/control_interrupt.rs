//! The control interrupt: everything that happens every loop period, and nothing else.
//!
//! TIM1 overflows every loop period exactly, 0.7 ms unless the configuration says otherwise. Its interrupt alone has
//! the highest priority, and critical sections do not mask it (see `critical_section.rs`), so it starts within a few
//! cycles of the overflow.
//!
//! **Deadline**: a run, the request it answers included, must end before the next overflow; one that does not is
//! counted and told to the board, which makes it a fault. What a tick does to the arm is decided in `shared::board`;
//! here inputs are read, outputs written, and messages passed on.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_stm32::{
    Peri,
    gpio::Input,
    interrupt,
    interrupt::{Interrupt, InterruptExt},
    pac,
    peripherals::TIM1,
    timer::low_level::{RoundTo, Timer},
};
use shared::{
    board::{Board, Inputs},
    protocol::{Event, Link, Mode, PackedSample, Request},
};

use crate::{
    clocks::CORE_CLOCK_HZ,
    currents::{Amplifiers, MeasuredCurrents},
    encoders::Encoders,
    interrupt_owned::InterruptOwned,
    last_fault,
    link::{ControlEnd, ExaminedRequest},
    load, storage,
    timing::Stopwatch,
};

/// The longest loop period, 0.7 ms, in core cycles: what the prescaler is chosen for.
const LONGEST_PERIOD_CYCLES: u64 = 117_600;

/// Core cycles in one step of the timer: the 16 bit counter needs two for the longest period.
const CYCLES_PER_TIMER_STEP: u32 = 2;

/// Everything the interrupt owns.
pub struct Control {
    /// Decides.
    pub board: &'static mut Board<&'static mut [PackedSample]>,
    /// Where the motors are.
    pub encoders: Encoders,
    /// What current they get.
    pub measured_currents: MeasuredCurrents,
    /// What current they are to get.
    pub amplifiers: Amplifiers,
    /// High when the emergency stop is pressed, or its wire broken.
    pub emergency_stop: Input<'static>,
    /// Its ends of the links, in the order of [`Link::ALL`].
    pub links: [ControlEnd; 2],
    /// The way to the flash memory.
    pub storage: storage::ControlEnd,
    /// The way to the identification of the load.
    pub load: load::ControlEnd,
    /// Measures it.
    pub stopwatch: Stopwatch,
}

struct Running {
    control: Control,
    /// Index of the link whose turn it is to be answered.
    next_link: usize,
    period_ns: u32,
    deadline_missed: bool,
    /// Whether the amplifiers were on when the run began.
    was_powered: bool,
    /// Whether this run had a change of mode to tell.
    mode_changed: bool,
}

static RUNNING: InterruptOwned<Running> = InterruptOwned::new();

static TICKS: AtomicU32 = AtomicU32::new(0);

/// Counts up with every completed run of the interrupt, wrapping.
pub fn ticks() -> u32 {
    TICKS.load(Ordering::Relaxed)
}

/// Hands over to the interrupt and starts the loop.
pub fn start(timer: Peri<'static, TIM1>, control: Control) {
    let period_ns = control.board.loop_period_ns();
    // SAFETY: the only call, since there is only one TIM1 to call it with, and the interrupt is enabled below.
    unsafe {
        RUNNING.hand_over(Running {
            control,
            next_link: 0,
            period_ns,
            deadline_missed: false,
            was_powered: false,
            mode_changed: false,
        })
    };
    let timer = Timer::new(timer);
    // Sets the prescaler; the period follows.
    timer.set_period_clocks(LONGEST_PERIOD_CYCLES, RoundTo::Faster);
    set_period(period_ns);
    // A new period takes effect at the next overflow, so that none is ever cut short or passed over.
    timer.set_autoreload_preload(true);
    // Loads the prescaler, which otherwise waits for the first overflow. That sets the overflow flag too.
    timer.generate_update_event();
    clear_overflow();
    timer.enable_update_interrupt(true);
    // SAFETY: the value that the interrupt uses is in place.
    unsafe { Interrupt::TIM1_UP_TIM10.enable() };
    timer.start();
    // Dropped, the driver would stop the timer.
    core::mem::forget(timer);
}

#[interrupt]
fn TIM1_UP_TIM10() {
    let cycles_since_overflow = u32::from(pac::TIM1.cnt().read().cnt()) * CYCLES_PER_TIMER_STEP;
    // SAFETY: called nowhere else, once a run, and the interrupt is enabled only after the value was handed over.
    let running = unsafe { RUNNING.get() };
    running.control.stopwatch.start(cycles_since_overflow);
    clear_overflow();
    running.tick();
    running.answer();
    running.store();
    running.follow_period();
    running.deadline_missed = pac::TIM1.sr().read().uif();
    running.control.stopwatch.stop(running.deadline_missed);
    TICKS.fetch_add(1, Ordering::Relaxed);
}

impl Running {
    fn tick(&mut self) {
        let control = &mut self.control;
        self.was_powered = control.amplifiers.are_enabled();
        // Both currents are sampled within 1.4 µs from here; the counts are read at the start of that.
        control.measured_currents.start();
        let counts = control.encoders.counts();
        let emergency_stop = control.emergency_stop.is_high();
        let current_code = control.measured_currents.finish().expect("the current converter stopped");

        let inputs = Inputs { counts, current_code, emergency_stop, deadline_missed: self.deadline_missed };
        if let Some(news) = control.load.news() {
            control.board.hear_of_load(&news);
        }
        let outputs = control.board.tick(&inputs);

        // Off before the command changes, on after it has.
        if !outputs.amplifier_enable {
            control.amplifiers.set_enabled(false);
        }
        control.amplifiers.set_commands(outputs.command_code);
        if outputs.amplifier_enable && !control.amplifiers.are_enabled() {
            control.amplifiers.set_enabled(true);
            control.stopwatch.restart();
        }

        self.mode_changed = outputs.event.is_some();
        if let Some(event) = &outputs.event {
            if let Event::Mode { mode: Mode::Fault(fault), .. } = event {
                last_fault::keep(fault);
            }
            for link in &mut control.links {
                link.event(event);
            }
        }
        if let Some(row) = outputs.load_row {
            control.load.row(row);
        }
        if let Some(row) = outputs.telemetry {
            control.links[row.link as usize].telemetry(row);
        }
    }

    /// At most one request a period, after the outputs: what a host asks for never delays the arm. Two hosts are
    /// answered in turns. None where the last run was too long: requests that take several periods, possible while the
    /// amplifiers are off, then leave the tasks a period in between, the one that feeds the watchdog among them. None
    /// either in a run that changed the mode, the last of a movement for one, which takes longer by itself.
    fn answer(&mut self) {
        if self.deadline_missed || self.mode_changed {
            return;
        }
        let Control { board, links, stopwatch, load, .. } = &mut self.control;
        let states = [links[0].state(), links[1].state()];
        for index in [self.next_link, 1 - self.next_link] {
            let answered = links[index].answer_next(|ExaminedRequest { message, findings }, reply| {
                if matches!(message.request, Request::Hello { .. }) {
                    board.report_timing(stopwatch.timing());
                    for (link, state) in Link::ALL.into_iter().zip(states) {
                        board.report_link(link, state.counters());
                    }
                }
                board.answer(Link::ALL[index], message.sequence, &message.request, findings, reply);
            });
            if answered {
                load.order(|| board.take_load_order());
                self.next_link = 1 - index;
                return;
            }
        }
        board.advance_check();
    }

    /// The flash memory is written to by a task; the board says what and when, and hears what came of it. Handing it over
    /// takes long, and has time until the run after the one that switches the amplifiers off.
    fn store(&mut self) {
        if self.was_powered {
            return;
        }
        let control = &mut self.control;
        if let Some(result) = control.storage.result() {
            control.board.end_store(result);
        }
        if let Some(parameters) = control.board.begin_store() {
            control.storage.order(parameters);
        }
    }

    /// A new configuration can bring another loop period.
    fn follow_period(&mut self) {
        let period_ns = self.control.board.loop_period_ns();
        if period_ns != self.period_ns {
            self.period_ns = period_ns;
            set_period(period_ns);
        }
    }
}

/// All loop periods are whole numbers of timer steps: 84 of them make a microsecond.
fn set_period(period_ns: u32) {
    const STEPS_PER_MICROSECOND: u32 = CORE_CLOCK_HZ / CYCLES_PER_TIMER_STEP / 1_000_000;
    let steps = period_ns / 1000 * STEPS_PER_MICROSECOND;
    // The board allows no period that does not fit; the shortest would be a harmless answer to one that does not.
    pac::TIM1.arr().write(|register| register.set_arr(u16::try_from(steps.saturating_sub(1)).unwrap_or(u16::MAX)));
}

fn clear_overflow() {
    // Writing a one leaves a flag as it is, so nothing is lost that happens at the same time.
    pac::TIM1.sr().write(|register| {
        register.0 = u32::MAX;
        register.set_uif(false);
    });
}
