//! The real firmware image with every request it may be asked while the amplifiers are on, at every loop period: no
//! control interrupt may be too long. `tests/run emulated` builds the image and runs these.

use std::time::Duration;

use armid::client::Client;
use armid_tests::emulated_board::control_time::{COMPUTED_TORQUE_LIMIT_US, ControlTime, POSITION_LIMIT_US};
use armid_tests::scenarios::{
    BoardUnderTest, Setup, greeted, prepared, robot_with_period, switched_on, true_model_for,
};
use shared::protocol::{
    ControlLaw, LOOP_PERIODS_NS, Mode, Model, ModelSlot, POINTS_PER_FRAME, Request, TrajectoryPart,
};
use shared::trajectory::{Fourier, Harmonic, MAX_HARMONICS, Paper, Trajectory};

/// Rows of the movement that takes longest to compute: 1 s.
const SERIES_ROWS: u32 = 1428;

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
    let Some(switch_on) = switched_on() else { return };
    let robot = robot_with_period(loop_period_ns);
    let model = true_model_for(&robot);
    let board = switch_on(Setup { robot: robot.clone(), ..Setup::default() });
    let mut client = greeted(&board);
    prepared(&mut client, &robot);
    client.upload(&model).expect("an accepted model");
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
    for (name, request) in requests_at_rest(&model) {
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
    let observations = BoardUnderTest::finish(board);

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
