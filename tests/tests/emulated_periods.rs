//! The real firmware image at every loop period, and every request it may be asked while the amplifiers are on: no
//! control interrupt may be too long. `tests/run emulated` builds the image and runs these.

use std::time::Duration;

use armid::board_setup::{board_model, configuration};
use armid::client::{Client, MovementPlan, Pose};
use armid::hidden_robot::HiddenRobot;
use armid::robot::Robot;
use armid_tests::emulated_board::control_time::{COMPUTED_TORQUE_LIMIT_US, ControlTime, POSITION_LIMIT_US};
use armid_tests::emulated_board::{EmulatedBoard, FIRMWARE_VARIABLE, firmware_from_environment};
use shared::protocol::{
    ControlLaw, LOOP_PERIODS_NS, Mode, Model, ModelSlot, POINTS_PER_FRAME, Request, TrajectoryPart,
};
use shared::trajectory::{Fourier, Harmonic, MAX_HARMONICS, Paper, Points, Trajectory};

const SEED: u64 = 5;

/// Rows of the short movement: 0.9 s, one every 0.7 ms.
const NOD_ROWS: u32 = 1285;

/// Rows of the movement that takes longest to compute: 1 s.
const SERIES_ROWS: u32 = 1428;

/// The paper's robot with another loop period.
fn robot(loop_period_ns: u32) -> Robot {
    Robot { loop_period_s: f64::from(loop_period_ns) * 1e-9, ..Robot::paper() }
}

fn model(robot: &Robot) -> Model {
    let hidden = HiddenRobot::draw(&Robot::paper(), SEED);
    board_model(robot, &hidden.to_model(toml::Table::new())).expect("a model for the board")
}

/// A board with its robot's constants and model, and a client; nothing where there is no image.
fn ready(robot: &Robot) -> Option<(EmulatedBoard, Client)> {
    let Some(firmware) = firmware_from_environment() else {
        println!("SKIPPED: {FIRMWARE_VARIABLE} names no image; run `tests/run emulated`, which builds one");
        return None;
    };
    let hidden = HiddenRobot::draw(&Robot::paper(), SEED);
    let board = EmulatedBoard::start(&firmware, robot, &hidden).expect("an image that runs");
    let mut client = Client::connect_from(Box::new(board.link()), 1).expect("a board that answers");
    client
        .prepare(&configuration(robot).expect("a safe robot"), Pose::DefaultsTo([0.0; 2]), false)
        .expect("a board that accepts its robot");
    client.upload(&model(robot)).expect("an accepted model");
    Some((board, client))
}

fn nod() -> Trajectory {
    let points = [[0.0, 0.0], [-0.1, 0.15], [-0.15, 0.1], [0.0, 0.0]];
    Trajectory::Points(Points::new(300_000_000, &points).expect("a movement through points"))
}

/// The movement that takes longest to compute: 1 s, half of it fading in and out.
fn longest_series() -> Fourier {
    let harmonic = Harmonic { cosine_rad: [0.0001, 0.0002], sine_rad: [0.0002, 0.0001] };
    Fourier {
        period_ns: 1_000_000_000,
        repeats: 1,
        fade_ns: 250_000_000,
        centre_rad: [-0.1, 0.1],
        harmonics: heapless::Vec::from_slice(&[harmonic; MAX_HARMONICS]).expect("as many as there may be"),
    }
}

/// Runs a movement under `law` and checks that it is whole and that no control interrupt was longer than `limit_us`.
fn runs_in_time(loop_period_ns: u32, law: ControlLaw, limit_us: f64) {
    let Some((board, mut client)) = ready(&robot(loop_period_ns)) else { return };
    client.load_trajectory(&nod()).expect("an accepted movement");
    let plan = MovementPlan { law, settle_ns: 50_000_000 };
    let movement = client.run(&plan, &mut |_| {}).expect("a movement");
    let timing = client.hello().expect("an answer").timing;
    let observations = board.finish().expect("a run without error");
    observations.check_always();

    let time = ControlTime::while_powered(&observations).expect("switched on and off again");
    println!("{:3} µs {law:?}: {time}", loop_period_ns / 1000);
    assert_eq!(movement.partial, None);
    assert_eq!((movement.planned_rows, movement.samples.len() as u32), (NOD_ROWS, NOD_ROWS));
    assert_eq!((movement.streamed_rows, movement.differing_rows), (NOD_ROWS, 0));
    assert_eq!(timing.missed_deadlines, 0);
    assert!(time.longest().duration_us() <= limit_us, "{time}");
    // The overflows are a period apart, exactly.
    let ticks = &observations.ticks;
    for pair in ticks[ticks.len() / 2..].windows(2) {
        let apart_ns = pair[1].overflow_ns() - pair[0].overflow_ns();
        assert!((apart_ns - f64::from(loop_period_ns)).abs() < 30.0, "{apart_ns} ns apart at {} ns", pair[0].start_ns);
    }
}

#[test]
fn the_position_loop_runs_in_time_at_every_period() {
    for loop_period_ns in LOOP_PERIODS_NS {
        runs_in_time(loop_period_ns, ControlLaw::Position, POSITION_LIMIT_US);
    }
}

#[test]
fn computed_torque_runs_in_time_at_every_period() {
    for loop_period_ns in LOOP_PERIODS_NS {
        runs_in_time(loop_period_ns, ControlLaw::ComputedTorque, COMPUTED_TORQUE_LIMIT_US);
    }
}

/// Every request that is carried out while the amplifiers are on and nothing moves, those that move or end it last.
fn requests_at_rest(model: &Model) -> Vec<(&'static str, Request)> {
    let crc = model.crc();
    let mut wrong = *model;
    wrong.f[0] = 1e6;
    vec![
        ("hello", Request::Hello { protocol_version: shared::protocol::PROTOCOL_VERSION }),
        ("status", Request::Status),
        ("keep alive", Request::KeepAlive),
        ("recording info", Request::RecordingInfo),
        ("read rows", Request::ReadRecording { from: 0, count: u16::MAX }),
        ("read rows between checkpoints", Request::ReadRecording { from: 41 * 20 + 20, count: u16::MAX }),
        ("read rows at the end", Request::ReadRecording { from: SERIES_ROWS - 15, count: u16::MAX }),
        ("read trajectory", Request::ReadTrajectory),
        ("stage model", Request::StageModel { model: *model, crc }),
        ("stage wrong model", Request::StageModel { model: wrong, crc: wrong.crc() }),
        ("commit model", Request::CommitModel { crc }),
        ("read model", Request::ReadModel(ModelSlot::Active)),
        ("clear fault", Request::ClearFault),
        ("refused configuration", Request::ApplyConfiguration { crc: 0 }),
        ("refused position", Request::SetPosition { position_rad: [0.0; 2] }),
        ("refused arm", Request::Arm),
        (
            "refused points",
            Request::LoadTrajectory(TrajectoryPart::Points {
                from: 0,
                points_rad: heapless::Vec::from_slice(&[[0.0; 2]; POINTS_PER_FRAME]).expect("as many as there may be"),
            }),
        ),
        ("run", Request::Run { law: ControlLaw::Position, stream: true, settle_ns: 100_000_000 }),
        ("stop", Request::Stop),
    ]
}

/// Sends every request while the board is at rest with the amplifiers on, and prints and checks the longest control
/// interrupt of each.
fn every_request_in_time(loop_period_ns: u32, law: ControlLaw, limit_us: f64) {
    let robot = robot(loop_period_ns);
    let Some((board, mut client)) = ready(&robot) else { return };
    let now_ns = |client: &Client| client.now().as_nanos() as u64;
    let movement = Trajectory::Fourier(longest_series());
    client.load_trajectory(&movement).expect("an accepted movement");
    client.command(Request::Arm).expect("armed");
    client.request(Request::Run { law, stream: true, settle_ns: 0 }).expect("begun");
    let mut asked = Vec::new();
    let mut moving_from_ns = now_ns(&client);
    while !matches!(client.status().expect("a status").mode, Mode::Holding(_)) {
        // While it moves: what a host asks to see how far it is, and what it never should.
        for request in [Request::Status, Request::ReadRecording { from: 0, count: 15 }, Request::ReadTrajectory] {
            client.request(request).expect("an answer");
        }
        // A host that loads while it moves is refused, unless it has arrived meanwhile.
        let _ = client.request(Request::LoadTrajectory(TrajectoryPart::Fourier(longest_series())));
        asked.push(("asked while moving", moving_from_ns, now_ns(&client)));
        moving_from_ns = now_ns(&client);
    }
    // That may have been taken in just now.
    client.load_trajectory(&movement).expect("an accepted movement");
    for (name, request) in requests_at_rest(&model(&robot)) {
        let from_ns = now_ns(&client);
        // Refused or not is not the question here.
        let _ = client.request(request);
        asked.push((name, from_ns, now_ns(&client)));
    }
    while client.status().expect("a status").mode != Mode::Armed {}
    const LOAD: &str = "load and check";
    const VERDICT: &str = "load, verdict and margins";
    for part in [TrajectoryPart::Paper(Paper { period_ns: 3_650_000_000 }), TrajectoryPart::Fourier(longest_series())] {
        let from_ns = now_ns(&client);
        client.request(Request::LoadTrajectory(part)).expect("taken");
        board.run(Duration::from_millis(20));
        asked.push((LOAD, from_ns, now_ns(&client)));
    }
    let from_ns = now_ns(&client);
    client.load_trajectory(&Trajectory::Paper(Paper { period_ns: 500_000_000 })).expect_err("too fast");
    client.load_trajectory(&Trajectory::Paper(Paper { period_ns: 3_000_000_000 })).expect("accepted");
    client.request(Request::ReadTrajectory).expect("margins");
    asked.push((VERDICT, from_ns, now_ns(&client)));
    let timing = client.hello().expect("an answer").timing;
    let from_ns = now_ns(&client);
    client.command(Request::Disarm).expect("disarmed");
    asked.push(("disarm", from_ns, now_ns(&client)));
    let observations = board.finish().expect("a run without error");
    observations.check_always();

    let mut longest: Vec<(&str, ControlTime)> = Vec::new();
    for (name, from_ns, to_ns) in asked {
        let time = ControlTime::within(&observations, from_ns, to_ns).expect("a control interrupt");
        match longest.iter_mut().find(|(known, _)| *known == name) {
            Some((_, known)) if known.longest().instructions >= time.longest().instructions => {}
            Some((_, known)) => *known = time,
            None => longest.push((name, time)),
        }
    }
    for (name, time) in &longest {
        println!("{:3} µs {law:?}, {name}: {time}", loop_period_ns / 1000);
    }
    assert_eq!(timing.missed_deadlines, 0);
    for (name, time) in &longest {
        assert!(time.longest().duration_us() <= limit_us, "{name}: {time}");
    }
}

#[test]
fn no_request_makes_the_position_loop_late() {
    for loop_period_ns in LOOP_PERIODS_NS {
        every_request_in_time(loop_period_ns, ControlLaw::Position, POSITION_LIMIT_US);
    }
}

#[test]
fn no_request_makes_computed_torque_late() {
    for loop_period_ns in LOOP_PERIODS_NS {
        every_request_in_time(loop_period_ns, ControlLaw::ComputedTorque, COMPUTED_TORQUE_LIMIT_US);
    }
}
