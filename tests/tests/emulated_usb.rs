//! The real firmware image on an emulated board, with a USB host at its port and armid's own client above that.
//!
//! `tests/run emulated` builds the image and runs these. Without an image in the environment they pass without having
//! shown anything, and say so.

use std::collections::HashMap;
use std::sync::OnceLock;
use std::time::Duration;

use armid::board_setup::configuration;
use armid::client::{Client, Movement, MovementPlan, MovementProgress, Pose};
use armid::hidden_robot::HiddenRobot;
use armid::robot::Robot;
use armid_tests::emulated_board::observations::{Observations, Tick};
use armid_tests::emulated_board::usb::{LINE_CODING, UsbAction};
use armid_tests::emulated_board::{EmulatedBoard, EmulatedLink, FIRMWARE_VARIABLE, firmware_from_environment};
use shared::protocol::usb::{MANUFACTURER, PRODUCT, PRODUCT_ID, VENDOR_ID, serial_number};
use shared::protocol::{ControlLaw, Fault, LinkCounters, Mode, ROWS_PER_FRAME, Reply, Request};
use shared::trajectory::{Points, Trajectory};

const SEED: u64 = 5;
const PERIOD_NS: f64 = 700_000.0;

/// When a disturbance begins, in rows.
const DISTURBED_AT_ROW: u32 = 500;

fn switched_on() -> Option<EmulatedBoard> {
    let Some(firmware) = firmware_from_environment() else {
        println!("SKIPPED: {FIRMWARE_VARIABLE} names no image; run `tests/run emulated`, which builds one");
        return None;
    };
    let robot = Robot::paper();
    Some(EmulatedBoard::start(&firmware, &robot, &HiddenRobot::draw(&robot, SEED)).expect("an image that runs"))
}

/// Always the same sequence numbers, or the same run would not send the same bytes.
fn connected(link: EmulatedLink) -> Client {
    Client::connect_from(Box::new(link), 1).expect("a board that answers")
}

fn prepare(client: &mut Client, trajectory: &Trajectory) {
    let configuration = configuration(&Robot::paper()).expect("a safe robot");
    client.prepare(&configuration, Pose::DefaultsTo([0.0; 2]), false).expect("a board that accepts its robot");
    client.load_trajectory(trajectory).expect("an accepted movement");
}

/// Lasts 2.1 s.
fn to_and_fro() -> Trajectory {
    let points =
        [[0.0, 0.0], [-0.1, 0.15], [-0.15, 0.1], [-0.05, 0.0], [-0.1, 0.1], [-0.2, 0.05], [-0.1, 0.1], [0.0, 0.0]];
    Trajectory::Points(Points::new(300_000_000, &points).expect("a movement through points"))
}

/// Runs the loaded movement; `disturb` acts once, in the middle of it.
fn run(client: &mut Client, mut disturb: impl FnMut()) -> Movement {
    let plan = MovementPlan { law: ControlLaw::Position, settle_ns: 200_000_000 };
    let mut is_disturbed = false;
    client
        .run(&plan, &mut |progress| {
            if matches!(progress, MovementProgress::Running { rows: DISTURBED_AT_ROW.., .. }) && !is_disturbed {
                is_disturbed = true;
                disturb();
            }
        })
        .expect("a movement")
}

/// The board's counters for its USB link.
fn usb_counters(client: &mut Client) -> LinkCounters {
    client.hello().expect("an answer").links[0]
}

/// Nothing lost, nothing differs, whatever happened on the way.
fn check_complete(movement: &Movement) {
    assert_eq!(movement.partial, None);
    assert_eq!(movement.samples.len() as u32, movement.planned_rows);
    assert_eq!(movement.differing_rows, 0);
    assert_eq!(movement.streamed_rows + movement.reread_rows, movement.planned_rows);
}

/// Ends the run and checks what must be true of every one: no restart, no register touched that no model answers for,
/// and no control tick missing or late while the amplifiers are on. While they are off, checking a configuration may take
/// longer than a period.
fn finish(board: EmulatedBoard) -> Observations {
    let observations = board.finish().expect("a run without error");
    observations.check_always();
    assert!(observations.restarts.is_empty(), "{:?}", observations.restarts);
    let traffic = &observations.usb;
    println!(
        "USB: {} packets to the board, {} from it, recognised {} times",
        traffic.packets_to_board, traffic.packets_from_board, traffic.enumerations
    );
    let mut is_on_since_ns = None;
    for change in &observations.outputs {
        match (change.outputs.amplifiers_enabled, is_on_since_ns) {
            (true, None) => is_on_since_ns = Some(change.at_ns),
            (false, Some(since_ns)) => {
                is_on_since_ns = None;
                check_ticks(&observations, since_ns, change.at_ns);
            }
            _ => {}
        }
    }
    observations
}

/// Checks every control tick in this time.
fn check_ticks(observations: &Observations, from_ns: u64, to_ns: u64) {
    let ticks: Vec<&Tick> =
        observations.ticks.iter().filter(|tick| (from_ns..to_ns).contains(&tick.start_ns)).collect();
    let Some(first) = ticks.first() else { return };
    for (index, tick) in ticks.iter().enumerate() {
        let off_ns = tick.overflow_ns() - first.overflow_ns() - index as f64 * PERIOD_NS;
        assert!(off_ns.abs() < 30.0, "tick {index} at {} ns is off by {off_ns} ns", tick.start_ns);
    }
    let steps = ticks.iter().map(|tick| tick.timer_steps);
    let (earliest, latest) = (steps.clone().min().unwrap_or(0), steps.max().unwrap_or(0));
    let mut instructions: Vec<u64> = ticks.iter().map(|tick| tick.instructions).collect();
    instructions.sort_unstable();
    println!(
        "{} control ticks with the amplifiers on: started {earliest} to {latest} steps of 12 ns after the overflow, took \
         {} instructions (median) to {}",
        ticks.len(),
        instructions[instructions.len() / 2],
        instructions[instructions.len() - 1],
    );
    // Two instructions: nothing of USB keeps the control interrupt from starting.
    assert!(latest - earliest <= 2, "control ticks started {earliest} to {latest} steps late");
}

/// The control was that of the undisturbed movement: the same references, to each error the same command, and errors that
/// are the same or follow an encoder edge that was counted a tick sooner or later.
///
/// The emulator starts an interrupt between two instructions, so what runs meanwhile moves a control tick by some
/// nanoseconds. An encoder edge that happens just then is counted in another tick, and as many of the next rows as it
/// pleases the arm differ by that one count.
fn check_undisturbed(movement: &Movement, reference: &Movement) {
    let mut command_to = [HashMap::new(), HashMap::new()];
    for row in &reference.samples {
        for (joint, commands) in command_to.iter_mut().enumerate() {
            let command = *commands.entry(row.error_counts[joint]).or_insert(row.command_code[joint]);
            assert_eq!(command, row.command_code[joint], "the position loop answers an error always alike");
        }
    }
    let mut answered = 0;
    let mut largest = 0;
    for (ours, theirs) in movement.samples.iter().zip(&reference.samples) {
        assert_eq!(ours.reference_counts, theirs.reference_counts, "row {}", ours.index);
        for (joint, commands) in command_to.iter().enumerate() {
            if let Some(&command) = commands.get(&ours.error_counts[joint]) {
                assert_eq!(ours.command_code[joint], command, "row {}, joint {joint}", ours.index);
                answered += 1;
            }
            largest = largest.max(ours.error_counts[joint].abs_diff(theirs.error_counts[joint]));
        }
    }
    let commands = 2 * reference.samples.len();
    println!("{answered} of {commands} commands compared; errors differ by {largest} counts at most");
    assert!(100 * answered >= 99 * commands, "errors as the undisturbed movement never has");
    assert!(largest <= 1, "the arm went elsewhere");
}

/// What the same movement brings when nothing disturbs it; run once for all tests.
fn undisturbed() -> Option<&'static Movement> {
    static MOVEMENT: OnceLock<Option<Movement>> = OnceLock::new();
    let run_it = || {
        let board = switched_on()?;
        let mut client = connected(board.usb_link());
        prepare(&mut client, &to_and_fro());
        let movement = run(&mut client, || {});
        check_complete(&movement);
        assert_eq!((movement.reread_rows, client.repeats()), (0, 0));
        finish(board);
        Some(movement)
    };
    MOVEMENT.get_or_init(run_it).as_ref()
}

#[test]
fn a_host_recognises_the_board_and_its_serial_port() {
    let Some(board) = switched_on() else { return };
    let client = connected(board.usb_link());
    println!("answers over USB {:.1} ms after the start", board.now().as_secs_f64() * 1e3);
    assert_eq!(client.info().identity.board, "nucleo-f429zi");
    let chip_id = client.info().identity.chip_id;
    let observations = finish(board);
    let found = &observations.usb.found;
    assert_eq!((observations.usb.enumerations, observations.usb.failures), (1, 0));

    let device = &found.device;
    assert_eq!((device.len(), device[0], device[1]), (18, 18, 1));
    assert_eq!(device[4..8], [0xEF, 2, 1, 64], "several interfaces that belong together; 64 bytes at endpoint 0");
    assert_eq!(u16::from_le_bytes([device[8], device[9]]), VENDOR_ID);
    assert_eq!(u16::from_le_bytes([device[10], device[11]]), PRODUCT_ID);
    assert_eq!(device[17], 1, "one configuration");
    let serial = String::from_utf8(serial_number(&chip_id).to_vec()).expect("digits");
    assert_eq!(found.strings, [MANUFACTURER, PRODUCT, serial.as_str()]);

    let configuration = &found.configuration;
    assert_eq!(usize::from(u16::from_le_bytes([configuration[2], configuration[3]])), configuration.len());
    assert_eq!(configuration[4], 2, "two interfaces");
    assert_eq!(configuration[7], 0xC0, "has its own power, wakes nobody");
    assert_eq!(configuration[8], 0, "takes none from the bus");
    let mut descriptors = Vec::new();
    let mut rest = configuration.as_slice();
    while let Some((descriptor, after)) = rest.first().and_then(|&length| rest.split_at_checked(length.into())) {
        descriptors.push(descriptor);
        rest = after;
    }
    let of_kind =
        |kind: u8| -> Vec<&[u8]> { descriptors.iter().copied().filter(|descriptor| descriptor[1] == kind).collect() };
    // Number, alternate setting, endpoints, class, subclass, protocol.
    let interfaces: Vec<&[u8]> = of_kind(4).iter().map(|interface| &interface[2..8]).collect();
    assert_eq!(interfaces, [[0, 0, 1, 0x02, 0x02, 0x00], [1, 0, 2, 0x0A, 0x00, 0x00]], "control and data of CDC-ACM");
    // Subtypes header, abstract control management, union.
    let functional: Vec<u8> = of_kind(0x24).iter().map(|functional| functional[2]).collect();
    assert_eq!(functional, [0x00, 0x02, 0x06]);
    // Address, kind (interrupt or bulk), size.
    let endpoints: Vec<&[u8]> = of_kind(5).iter().map(|endpoint| &endpoint[2..6]).collect();
    assert_eq!(endpoints, [[0x81, 3, 8, 0], [0x01, 2, 64, 0], [0x82, 2, 64, 0]]);

    assert_eq!(found.line_coding, LINE_CODING);
}

#[test]
fn a_movement_is_streamed_whole_over_usb() {
    let Some(board) = switched_on() else { return };
    let mut client = connected(board.usb_link());
    prepare(&mut client, &armid::trajectory_file::paper(3.65).expect("the paper's movement"));
    let movement = run(&mut client, || {});
    check_complete(&movement);
    assert_eq!(movement.streamed_rows, movement.planned_rows, "every row came with the stream");
    let counters = usb_counters(&mut client);
    assert_eq!((counters.telemetry_dropped, counters.replies_dropped, counters.bad_frames), (0, 0, 0));
    assert_eq!((client.frames().bad(), client.repeats()), (0, 0));
    println!("{} rows streamed", movement.streamed_rows);
    finish(board);
}

#[test]
fn a_pulled_cable_disturbs_nothing_and_loses_no_row() {
    let Some(reference) = undisturbed() else { return };
    let once = || {
        let board = switched_on().expect("the same image");
        let mut client = connected(board.usb_link());
        prepare(&mut client, &to_and_fro());
        let movement = run(&mut client, || board.unplug_usb_for(Duration::from_millis(400)));
        let counters = usb_counters(&mut client);
        assert_eq!(client.reconnections(), 1);
        (movement, counters, finish(board))
    };
    let (movement, counters, observations) = once();
    println!("{} rows streamed, {} read again; {counters:?}", movement.streamed_rows, movement.reread_rows);
    check_complete(&movement);
    assert_eq!(observations.usb.enumerations, 2);
    // 0.4 s without a cable, and what the host needs to recognise the board.
    assert!((570..1000).contains(&movement.reread_rows), "{}", movement.reread_rows);
    // What was lost was counted, but for what was on its way when the cable was pulled: a packet, two frames.
    assert!((0..=4).contains(&(movement.reread_rows as i64 - i64::from(counters.telemetry_dropped))), "{counters:?}");
    check_undisturbed(&movement, reference);
    let again = once();
    assert!((movement, counters) == (again.0, again.1), "another run went differently");
    assert!(observations == again.2, "another run was seen differently");
}

#[test]
fn a_reader_that_stalls_disturbs_nothing_and_loses_no_row() {
    let Some(reference) = undisturbed() else { return };
    let board = switched_on().expect("the same image");
    let mut client = connected(board.usb_link());
    prepare(&mut client, &to_and_fro());
    let movement = run(&mut client, || board.stall_usb_for(Duration::from_millis(400)));
    let counters = usb_counters(&mut client);
    println!("{} rows streamed, {} read again; {counters:?}", movement.streamed_rows, movement.reread_rows);
    check_complete(&movement);
    assert_eq!(client.reconnections(), 0);
    // 0.4 s are 571 rows. The packet that was ready and those of the last tenth of a second may still arrive.
    assert!((400..600).contains(&movement.reread_rows), "{}", movement.reread_rows);
    assert_eq!(counters.telemetry_dropped, movement.reread_rows);
    check_undisturbed(&movement, reference);
    finish(board);
}

#[test]
fn a_bus_put_to_sleep_disturbs_nothing_and_loses_no_row() {
    let Some(reference) = undisturbed() else { return };
    let board = switched_on().expect("the same image");
    let mut client = connected(board.usb_link());
    prepare(&mut client, &to_and_fro());
    let movement = run(&mut client, || {
        board.plan_on_usb(Duration::ZERO, UsbAction::Suspend(true));
        board.plan_on_usb(Duration::from_millis(200), UsbAction::Suspend(false));
    });
    let counters = usb_counters(&mut client);
    println!("{} rows streamed, {} read again; {counters:?}", movement.streamed_rows, movement.reread_rows);
    check_complete(&movement);
    assert!((280..400).contains(&movement.reread_rows), "{}", movement.reread_rows);
    assert!((0..=4).contains(&(movement.reread_rows as i64 - i64::from(counters.telemetry_dropped))), "{counters:?}");
    check_undisturbed(&movement, reference);
    finish(board);
}

#[test]
fn a_cable_pulled_for_longer_than_the_link_may_be_silent_stops_the_arm() {
    let Some(board) = switched_on() else { return };
    let mut client = connected(board.usb_link());
    prepare(&mut client, &to_and_fro());
    let movement = run(&mut client, || board.unplug_usb_for(Duration::from_millis(1300)));
    println!("{:?}", movement.partial);
    let status = client.status().expect("a status");
    assert!(matches!(status.mode, Mode::Fault(Fault::LinkLost { .. })), "{:?}", status.mode);
    assert!(movement.partial.is_some());
    // Everything up to the fault is there: a second after the board heard the host last.
    let recorded = movement.recording.expect("what the board says").rows;
    assert_eq!(movement.samples.len() as u32, recorded);
    // The host shows itself every 0.1 s.
    assert!((1780..1940).contains(&recorded), "{recorded}");
    finish(board);
}

#[test]
fn both_links_are_served_at_once() {
    let Some(reference) = undisturbed() else { return };
    let board = switched_on().expect("the same image");
    let mut client = connected(board.usb_link());
    let mut serial = connected(board.link());
    prepare(&mut client, &to_and_fro());
    let plan = MovementPlan { law: ControlLaw::Position, settle_ns: 200_000_000 };
    let mut answers = 0;
    let movement = client
        .run(&plan, &mut |progress| {
            if matches!(progress, MovementProgress::Running { rows, .. } if rows % 10 == 0) {
                let status = serial.status().expect("an answer over the serial line");
                assert!(status.mode.is_powered());
                answers += 1;
            }
        })
        .expect("a movement");
    check_complete(&movement);
    assert_eq!(movement.reread_rows, 0);
    assert!(answers > 200, "{answers}");
    assert_eq!((client.repeats(), serial.repeats()), (0, 0));
    let links = client.hello().expect("an answer").links;
    println!("{answers} answers over the serial line meanwhile; {links:?}");
    for link in links {
        assert_eq!((link.telemetry_dropped, link.replies_dropped, link.bad_frames), (0, 0, 0));
    }
    check_undisturbed(&movement, reference);
    finish(board);
}

#[test]
fn answers_of_every_length_come_at_once() {
    let Some(board) = switched_on() else { return };
    let mut client = connected(board.usb_link());
    prepare(&mut client, &to_and_fro());
    run(&mut client, || {});
    // Sequence numbers, first rows and numbers of rows of every length on the wire. Some of the answers fill their last
    // packet to the last byte.
    for sequence in [1, 1 << 8, 1 << 15, 1 << 22, 1 << 29] {
        client = Client::connect_from(Box::new(board.usb_link()), sequence).expect("a board that answers");
        for from in [0, 1000] {
            for count in 1..=ROWS_PER_FRAME as u16 {
                let reply = client.request(Request::ReadRecording { from, count }).expect("rows");
                assert!(matches!(reply, Reply::Rows(rows) if rows.rows.len() == usize::from(count)));
            }
        }
        assert_eq!(client.repeats(), 0);
    }
    let observations = finish(board);
    println!("{} empty packets ended a transfer", observations.usb.empty_packets);
    assert!(observations.usb.empty_packets > 0);
}

#[test]
fn a_host_that_comes_late_gets_nothing_old_and_no_loss_is_counted_before() {
    let Some(board) = switched_on() else { return };
    board.plan_on_usb(Duration::ZERO, UsbAction::Plug(false));
    let mut serial = connected(board.link());
    prepare(&mut serial, &to_and_fro());
    // More events than a link could hold.
    for _ in 0..10 {
        serial.command(Request::Arm).expect("armed");
        serial.command(Request::Disarm).expect("disarmed");
    }
    board.plan_on_usb(Duration::ZERO, UsbAction::Plug(true));
    let mut client = connected(board.usb_link());
    let counters = usb_counters(&mut client);
    assert_eq!((counters.telemetry_dropped, counters.replies_dropped, counters.bad_frames), (0, 0, 0));
    let until = client.now() + Duration::from_millis(50);
    assert_eq!(client.next_unasked(until).expect("a link"), None, "something old came");
    // From now on it takes part.
    serial.command(Request::Arm).expect("armed");
    let until = client.now() + Duration::from_millis(50);
    assert!(client.next_unasked(until).expect("a link").is_some(), "the event did not come");
    serial.command(Request::Disarm).expect("disarmed");
    finish(board);
}

#[test]
fn a_cable_pulled_at_any_moment_of_the_recognition_can_be_plugged_in_again() {
    let Some(board) = switched_on() else { return };
    // The host asks its first question 120 ms after the cable was plugged in, the others from 140 ms on.
    let moments_us = (120_000..120_200).step_by(10).chain((140_000..148_000).step_by(430));
    let mut pulled = 0;
    for moment_us in moments_us {
        board.plan_on_usb(Duration::ZERO, UsbAction::Plug(false));
        board.run(Duration::from_millis(5));
        board.plan_on_usb(Duration::ZERO, UsbAction::Plug(true));
        board.run(Duration::from_micros(moment_us));
        pulled += 1;
    }
    board.unplug_usb_for(Duration::from_millis(400));
    board.run(Duration::from_millis(400));
    let mut client = connected(board.usb_link());
    assert_eq!(client.status().expect("a status").mode, Mode::Idle);
    let observations = finish(board);
    println!("pulled {pulled} times, recognised {} times", observations.usb.enumerations);
}
