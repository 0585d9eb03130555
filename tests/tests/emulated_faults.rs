//! Faults of the chip and of its program, in the middle of a movement of the real image: each ends in safe outputs, in
//! a restart, or in a fault with a name, and so much later.
//!
//! Nothing in the image helps with this: code, memory and registers are changed from outside, between two
//! instructions. The board needs the clock that comes from the ST-LINK; without it it stays in its start-up code, where
//! nothing drives the outputs yet, so that is not a fault to get out of here.

use std::time::Duration;

use armid::client::{Client, Movement, MovementProgress};
use armid_tests::emulated_board::damage::{HANG, ImageMap, Variable, switch_vector_table};
use armid_tests::emulated_board::observations::Observations;
use armid_tests::emulated_board::{EmulatedBoard, firmware_from_environment};
use armid_tests::scenarios::{
    BoardUnderTest, Setup, check_complete, loaded, nod, paper_movement, plan, ready, switched_on,
};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::{Rng as _, SeedableRng as _};
use rigless::device::ResetCause;
use rigless::emulator::Host;
use rigless::mcu::Operate as _;
use rigless::soc::Width;
use shared::protocol::{ControlLaw, Fault, Mode, Request, ResetCause as ReportedCause};

/// Row of the movement at which it happens: the arm is moving fast then.
const AT_ROW: u32 = 300;

/// Loop period, a run of the control interrupt, and some slack.
const NEXT_TICK_NS: u64 = 750_000;

/// How often the watchdog's task looks whether the control interrupt is alive.
const LOOK_NS: u64 = 10_000_000;

/// Its timeout with the nominal clock of 32 kHz, a look, and some slack. The real clock is anywhere from 17 to 47 kHz.
const WATCHDOG_NS: u64 = 50_000_000 + LOOK_NS + 2_000_000;

/// Control register of the control interrupt's timer; 0 stops it.
const TIM1_CONTROL: u64 = 0x4001_0000;

/// Second control register of the current converter; 0 switches it off.
const ADC1_CONTROL: u64 = 0x4001_2008;

/// Counter of joint 2.
const TIM2_COUNTER: u64 = 0x4000_0024;

/// Control registers of the DMA streams that move received and sent bytes. At 0, or without their lowest bit, they stop.
const DMA1_STREAM1_CONTROL: u64 = 0x4002_6028;
const DMA1_STREAM3_CONTROL: u64 = 0x4002_6058;

fn image_map() -> ImageMap {
    ImageMap::read(&firmware_from_environment().expect("an image, for there is a board that runs it"))
}

/// A movement in the middle of which something happens to the board.
struct Struck {
    board: EmulatedBoard,
    client: Client,
    movement: Movement,
    at_ns: u64,
}

fn strike(board: EmulatedBoard, mut client: Client, deed: impl FnOnce(&EmulatedBoard)) -> Struck {
    let mut deed = Some(deed);
    let mut at_ns = 0;
    let movement = client
        .run(&plan(ControlLaw::Position), &mut |progress| {
            if matches!(progress, MovementProgress::Running { rows: AT_ROW.., .. })
                && let Some(deed) = deed.take()
            {
                deed(&board);
                at_ns = board.now().as_nanos() as u64;
            }
        })
        .expect("a movement");
    assert!(deed.is_none(), "it did not come to that");
    Struck { board, client, movement, at_ns }
}

/// The same with the short movement.
fn strike_nod(switch_on: impl Fn(Setup) -> EmulatedBoard, deed: impl FnOnce(&EmulatedBoard)) -> Struck {
    let board = switch_on(Setup::default());
    let client = loaded(&board);
    strike(board, client, deed)
}

/// Writes a register as the processor would.
fn write_register(board: &EmulatedBoard, address: u64, value: u64) {
    board.intervene(move |session, _, at| {
        session.board_mut().chip_mut().write(at, address, Width::W32, value).expect("a register");
    });
}

/// Stops a DMA stream as an error on its bus does: the rest of its register stays as it is.
fn stop_stream(board: &EmulatedBoard, control: u64) {
    board.intervene(move |session, _, at| {
        let chip = session.board_mut().chip_mut();
        let value = chip.read(at, control, Width::W32).expect("a register");
        chip.write(at, control, Width::W32, value & !1).expect("a register");
    });
}

fn word(host: &mut dyn Host, address: u64) -> u64 {
    host.read(address, Width::W32).expect("memory")
}

/// Where the image begins.
const VECTOR_TABLE: u64 = 0x0800_0000;

/// Bytes of the vector table: 16 exceptions and 91 interrupts.
const VECTOR_TABLE_BYTES: u64 = 4 * (16 + 91);

/// Place of the control interrupt in the vector table: interrupt 25.
const CONTROL_VECTOR_OFFSET: u64 = 4 * (16 + 25);

/// Code that runs instead of the watchdog's task when that is due next, which is within [`LOOK_NS`].
enum Astray {
    /// The task hangs, and with it all others, while the control interrupt goes on.
    Hang,
    /// The task panics.
    Panic,
    /// The task goes on as always, but the control interrupt hangs from now on.
    ControlInterruptHangs,
}

fn lead_astray(board: &EmulatedBoard, how: Astray) {
    let map = image_map();
    let task = map.variable(&["8watchdog", "4feed", "4POOL"]);
    let functions = map.task_functions();
    // The end of the recording, which a short movement does not reach. Tables have to be aligned.
    let rows = map.variable(&["main_task", "4ROWS"]);
    let table = (rows.address + rows.size - 8192) & !1023;
    let [code_at, hang_at] = [table + 1024, table + 2048];
    board.intervene(move |_, host, _| {
        let places = (task.address..task.address + task.size).step_by(4);
        let words: Vec<(u64, u64)> = places.map(|place| (place, word(host, place))).collect();
        let names: Vec<(u64, u64)> = words.into_iter().filter(|(_, word)| functions.contains(word)).collect();
        let [(place, function)] = names[..] else { panic!("one function of the task, not {names:x?}") };
        for offset in (0..VECTOR_TABLE_BYTES).step_by(4) {
            let vector = word(host, VECTOR_TABLE + offset);
            let vector = if offset == CONTROL_VECTOR_OFFSET { hang_at | 1 } else { vector };
            host.write(table + offset, Width::W32, vector).expect("memory");
        }
        let code = match how {
            Astray::Hang => HANG.to_vec(),
            Astray::Panic => map.panic(),
            Astray::ControlInterruptHangs => switch_vector_table(table, function),
        };
        for (at, code) in [(code_at, &code[..]), (hang_at, &HANG)] {
            for (place, &halfword) in (at..).step_by(2).zip(code) {
                host.write(place, Width::W16, halfword.into()).expect("memory");
            }
        }
        host.write(place, Width::W32, code_at | 1).expect("memory");
    });
}

/// The board restarted for the watchdog, and for nothing else; it is idle again and says why.
fn check_restarted(struck: Struck, name: &str, fault: &str, off_within_ns: u64) -> Observations {
    let Struck { board, client, movement, at_ns } = struck;
    assert!(movement.partial.is_some(), "a movement that was cut short");
    drop(client);
    board.run(Duration::from_millis(100));
    let mut client = Client::connect_from(BoardUnderTest::link(&board), 1000).expect("a board that answers again");
    assert_eq!(client.info().identity.reset_cause, ReportedCause::Watchdog);
    let kept = client.info().last_fault;
    assert_eq!(kept.map(|kept| kept.name()), Some(fault), "{kept:?}");
    let status = client.status().expect("a status");
    assert_eq!((status.mode, status.pose_known), (Mode::Idle, false));

    let observations = BoardUnderTest::finish(board);
    let off_ns = observations.off_after_ns(at_ns).expect("switched off");
    let restart = observations.restarts.first().expect("a restart");
    println!(
        "{name}: off after {:.3} ms, restarted after {:.1} ms",
        off_ns as f64 * 1e-6,
        (restart.at_ns - at_ns) as f64 * 1e-6
    );
    assert!(off_ns <= off_within_ns, "off after {off_ns} ns");
    assert!(restart.at_ns - at_ns <= LOOK_NS + WATCHDOG_NS, "{restart:?} after {at_ns} ns");
    assert!(observations.restarts.iter().all(|restart| restart.cause == ResetCause::Model("IWDG")));
    assert!(observations.ends_safe());
    observations
}

#[test]
fn a_control_interrupt_that_hangs_restarts_the_board() {
    let Some(switch_on) = switched_on() else { return };
    let struck = strike_nod(switch_on, |board| lead_astray(board, Astray::ControlInterruptHangs));
    let observations = check_restarted(struck, "control interrupt hung", "watchdog", LOOK_NS + WATCHDOG_NS);
    // It did hang: for longer than a look at the clock takes, there was no tick.
    let ticks = observations.ticks.windows(2).map(|pair| pair[1].start_ns - pair[0].start_ns);
    assert!(ticks.max().is_some_and(|longest_ns| longest_ns > 30_000_000));
}

#[test]
fn a_control_interrupt_that_no_longer_comes_restarts_the_board() {
    let Some(switch_on) = switched_on() else { return };
    let struck = strike_nod(switch_on, |board| write_register(board, TIM1_CONTROL, 0));
    check_restarted(struck, "control timer stopped", "watchdog", WATCHDOG_NS);
}

#[test]
fn tasks_that_hang_restart_the_board() {
    let Some(switch_on) = switched_on() else { return };
    let struck = strike_nod(switch_on, |board| lead_astray(board, Astray::Hang));
    check_restarted(struck, "tasks hung", "watchdog", LOOK_NS + WATCHDOG_NS);
}

#[test]
fn a_panic_in_a_task_switches_off_and_restarts_the_board() {
    let Some(switch_on) = switched_on() else { return };
    let struck = strike_nod(switch_on, |board| lead_astray(board, Astray::Panic));
    check_restarted(struck, "panic in a task", "panic", LOOK_NS + NEXT_TICK_NS);
}

#[test]
fn a_panic_in_the_control_interrupt_switches_off_and_restarts_the_board() {
    let Some(switch_on) = switched_on() else { return };
    let struck = strike_nod(switch_on, |board| write_register(board, ADC1_CONTROL, 0));
    check_restarted(struck, "panic in the control interrupt (current converter off)", "panic", NEXT_TICK_NS);
}

#[test]
fn a_bus_error_switches_off_and_restarts_the_board() {
    let Some(switch_on) = switched_on() else { return };
    let struck = strike_nod(switch_on, |board| {
        board.intervene(|session, _, _| session.fail_next(TIM2_COUNTER, TIM2_COUNTER + 4));
    });
    check_restarted(struck, "bus error", "bus-error", NEXT_TICK_NS);
}

/// Received bytes no longer reach the program: for the board the host has gone.
#[test]
fn a_stuck_receiver_ends_in_a_lost_link() {
    let Some(switch_on) = switched_on() else { return };
    let board = switch_on(Setup::default());
    let mut client = ready(&board);
    client.load_trajectory(&paper_movement(3.65)).expect("an accepted movement");
    let timeout_ns = armid::board_setup::configuration(&armid_tests::scenarios::robot())
        .expect("a safe robot")
        .common
        .link_timeout_ns;
    let struck = strike(board, client, |board| write_register(board, DMA1_STREAM1_CONTROL, 0));
    assert!(struck.movement.partial.is_some());
    let observations = BoardUnderTest::finish(struck.board);
    let off_ns = observations.off_after_ns(struck.at_ns).expect("switched off");
    println!("receiver stuck: off after {:.1} ms", off_ns as f64 * 1e-6);
    assert!(off_ns <= timeout_ns + NEXT_TICK_NS);
    assert!(observations.ends_safe());
    assert_eq!(observations.restarts, []);
}

/// Stopped in the middle of a frame, the transmitter says nothing more, until that frame is given up.
#[test]
fn a_stuck_transmitter_is_started_again() {
    let Some(switch_on) = switched_on() else { return };
    let board = switch_on(Setup::default());
    let mut client = ready(&board);
    client.load_trajectory(&paper_movement(3.65)).expect("an accepted movement");
    let struck = strike(board, client, |board| {
        // Somewhere in two loop periods a frame is under way.
        for _ in 0..14 {
            board.run(Duration::from_micros(100));
            stop_stream(board, DMA1_STREAM3_CONTROL);
        }
    });
    let Struck { board, mut client, movement, .. } = struck;
    println!("transmitter stuck: {} requests repeated, {} rows read again", client.repeats(), movement.reread_rows);
    check_complete(&movement);
    // Lost is what was on the way, and what came until it was noticed; not a second of it, as without a new start.
    assert!(client.repeats() < 4, "{} repeats", client.repeats());
    assert!(movement.reread_rows > 0, "nothing was lost");
    assert_eq!(client.status().expect("an answer").mode, Mode::Idle);
    assert_eq!(BoardUnderTest::finish(board).restarts, []);
}

/// The board's state in the chip's memory.
fn board_state() -> Variable {
    image_map().variable(&["armid_firmware", "main_task", "5BOARD17h"])
}

fn flip(board: &EmulatedBoard, address: u64, bit: u32) {
    board.intervene(move |_, host, _| {
        let flipped = word(host, address) ^ (1 << bit);
        host.write(address, Width::W32, flipped).expect("memory");
    });
}

/// While the arm is held, a bit of the setpoint flips, which is a fault in the next tick, or of the position that is
/// compared with it: a small change moves the arm by as much and no further, a larger one is a fault with a name.
#[test]
fn a_flipped_bit_of_the_setpoint_is_a_fault_and_one_of_the_position_moves_the_arm_no_further_than_it_says() {
    let Some(switch_on) = switched_on() else { return };
    let state = board_state();
    let board = switch_on(Setup::default());
    let mut client = ready(&board);
    // A pose whose counts are found nowhere else.
    let pose = Request::SetPosition { position_rad: [-0.1234, 0.2345] };
    // Beyond it the change is too fast a movement.
    let largest_unnoticed_counts = 128;
    let mut setpoints = 0;
    for bit in [2, 5, 8, 9, 10, 13, 20, 31] {
        client.command(pose.clone()).expect("a pose");
        let [second, third] = client.status().expect("a status").position_counts;
        client.arm().expect("armed");
        let seen = [second, third].map(|counts| u64::from(counts.cast_unsigned()));
        // Below zero the encoders' cells are numbered one lower than what is seen of them.
        let cells = [second, third].map(|counts| u64::from((counts - 1).cast_unsigned()));
        let places: Vec<u64> = board.intervene(move |_, host, _| {
            let places = (state.address..state.address + state.size - 4).step_by(4);
            places.filter(|&place| [seen, cells].contains(&[word(host, place), word(host, place + 4)])).collect()
        });
        // Setpoint, position, and the position that the speed is measured from.
        assert!((2..=3).contains(&places.len()), "{places:x?}");
        client.command(Request::Disarm).expect("disarmed");
        for place in places {
            client.command(pose.clone()).expect("a pose");
            client.arm().expect("armed");
            board.run(Duration::from_millis(100));
            let before = client.status().expect("a status").position_counts;
            flip(&board, place, bit);
            board.run(Duration::from_millis(400));
            let status = client.status().expect("a status");
            let moved = i64::from(status.position_counts[0]) - i64::from(before[0]);
            let offset = place - state.address;
            println!("bit {bit} at {offset:#x}: {}, {moved} counts by its own count", status.mode.name());
            match status.mode {
                Mode::Armed => assert!(1 << bit < largest_unnoticed_counts && moved.abs() <= 2 << bit, "{status:?}"),
                Mode::Fault(fault) => {
                    println!("    {fault}");
                    setpoints += u32::from(fault == Fault::MemoryCorrupted);
                    client.command(Request::ClearFault).expect("cleared");
                }
                mode => panic!("{mode:?}"),
            }
            client.command(Request::Disarm).expect("disarmed");
        }
    }
    assert_eq!(setpoints, 8, "every flip of the setpoint was noticed by its copy");
    let observations = BoardUnderTest::finish(board);
    assert!(observations.ends_safe());
    assert_eq!(observations.restarts, []);
}

/// Anywhere in the board's state, in the middle of a movement: whatever comes of it, the board still does as it is told
/// by a host that switches it off, or has switched itself off.
#[test]
fn a_flipped_bit_anywhere_in_the_state_leaves_the_board_able_to_switch_off() {
    let Some(switch_on) = switched_on() else { return };
    let state = board_state();
    let mut random = Pcg64::seed_from_u64(1);
    for _ in 0..6 {
        let drawn = random.next_u64();
        let (offset, bit) = ((drawn >> 8) % (state.size / 4) * 4, (drawn % 32) as u32);
        let struck = strike_nod(&switch_on, |board| flip(board, state.address + offset, bit));
        let Struck { board, client, movement, at_ns } = struck;
        drop(client);
        let mut client = Client::connect_from(BoardUnderTest::link(&board), 1000).expect("a board that answers");
        client.command(Request::Disarm).expect("disarmed");
        let observations = BoardUnderTest::finish(board);
        println!(
            "bit {bit} at {offset:#06x}: {}, off after {:.1} ms",
            movement.partial.as_deref().unwrap_or("a movement as any"),
            observations.off_after_ns(at_ns).expect("off") as f64 * 1e-6
        );
        assert!(observations.ends_safe());
    }
}

/// What the faults above are measured against: without one, nothing of the kind happens.
#[test]
fn without_a_fault_nothing_happens() {
    let Some(switch_on) = switched_on() else { return };
    let struck = strike_nod(switch_on, |_| {});
    assert_eq!(struck.movement.partial, None);
    let mut client = struck.client;
    assert_eq!(client.hello().expect("an answer").last_fault, None::<Fault>);
    client.load_trajectory(&nod()).expect("an accepted movement");
    assert_eq!(BoardUnderTest::finish(struck.board).restarts, []);
}
