//! Links and client, on the simulated board and on links that misbehave. All time is virtual but the TCP socket's.

use std::cell::Cell;
use std::io::{Read as _, Write as _};
use std::net::TcpListener;
use std::rc::Rc;
use std::time::Duration;

use armid::board_setup::configuration;
use armid::client::{Client, ClientError, Movement, MovementPlan, Pose, SessionError};
use armid::compensation::board_model;
use armid::hidden_robot::HiddenRobot;
use armid::link::{Link, LinkError, MemoryFlash, SimulatedBoard, TcpLink};
use armid::robot::Robot;
use shared::protocol::{ControlLaw, Fault, Mode, ModelError, Refusal, Request, StoreState};
use shared::trajectory::{Points, Trajectory};

const SEED: u64 = 5;
const POSITION: MovementPlan = MovementPlan { law: ControlLaw::Position, settle_ns: 200_000_000 };
const COMPUTED_TORQUE: MovementPlan = MovementPlan { law: ControlLaw::ComputedTorque, settle_ns: 200_000_000 };

fn simulated() -> SimulatedBoard {
    SimulatedBoard::hidden(&Robot::paper(), SEED)
}

fn ready(link: impl Link + 'static) -> Client {
    let mut client = Client::connect(Box::new(link)).unwrap();
    client.prepare(&configuration(&Robot::paper()).unwrap(), Pose::DefaultsTo([0.0; 2]), false).unwrap();
    client
}

/// A small, quick movement: most tests are not about the movement.
fn nod() -> Trajectory {
    let points = [[0.0, 0.0], [-0.1, 0.15], [-0.15, 0.1], [0.0, 0.0]];
    Trajectory::Points(Points::new(300_000_000, &points).unwrap())
}

fn run(client: &mut Client, plan: &MovementPlan) -> Movement {
    client.load_trajectory(&nod()).unwrap();
    client.run(plan, &mut |_| {}).unwrap()
}

/// The truth of the simulated robot as a model for the board.
fn true_model() -> shared::protocol::Model {
    let robot = Robot::paper();
    board_model(&robot, &HiddenRobot::draw(&robot, SEED).to_model(toml::Table::new())).unwrap()
}

#[test]
fn a_movement_is_recorded_whole_and_the_stream_agrees_with_the_memory() {
    let mut client = ready(simulated());
    let movement = run(&mut client, &POSITION);
    assert_eq!(movement.partial, None);
    assert_eq!(movement.samples.len() as u32, movement.planned_rows);
    assert!((0..).zip(&movement.samples).all(|(index, sample)| sample.index == index));
    assert_eq!(movement.streamed_rows, movement.planned_rows);
    assert_eq!((movement.reread_rows, movement.differing_rows), (0, 0));
    assert_eq!(client.status().unwrap().mode, Mode::Idle);
    assert_eq!(client.repeats(), 0);
}

#[test]
fn two_runs_of_a_seed_are_the_same_to_the_bit() {
    let once = run(&mut ready(simulated()), &POSITION);
    assert_eq!(once, run(&mut ready(simulated()), &POSITION));
    let other = run(&mut ready(SimulatedBoard::hidden(&Robot::paper(), SEED + 1)), &POSITION);
    assert_ne!(once.samples, other.samples);
}

#[test]
fn computed_torque_with_the_true_model_stays_within_one_count() {
    let mut client = ready(simulated());
    let receipt = client.upload(&true_model()).unwrap();
    assert_eq!(receipt.active, true_model());
    assert_eq!(receipt.replaced_crc, None);
    assert_eq!(client.status().unwrap().active_model_crc, Some(receipt.crc));
    client.load_trajectory(&armid::trajectory_file::paper(3.65).unwrap()).unwrap();
    let movement = client.run(&COMPUTED_TORQUE, &mut |_| {}).unwrap();
    let within =
        movement.samples.iter().filter(|sample| sample.error_counts.iter().all(|error| error.abs() <= 1)).count();
    assert!(within as f64 >= 0.99 * movement.samples.len() as f64, "{within} of {}", movement.samples.len());
}

#[test]
fn computed_torque_without_a_model_is_refused() {
    let mut client = ready(simulated());
    client.load_trajectory(&nod()).unwrap();
    let error = client.run(&COMPUTED_TORQUE, &mut |_| {}).unwrap_err();
    assert!(matches!(error, ClientError::Refused { refusal: Refusal::NoModel, .. }), "{error}");
    assert_eq!(client.status().unwrap().mode, Mode::Idle, "a refused start leaves nothing switched on");
}

#[test]
fn the_board_refuses_what_the_host_should_not_have_sent() {
    let mut client = ready(simulated());
    let mut model = true_model();
    model.f[6] = 2.3;
    model.f[3] = -1.2;
    let error = client.upload(&model).unwrap_err();
    let SessionError::Client(ClientError::Refused { refusal, .. }) = &error else { panic!("{error}") };
    assert!(matches!(refusal, Refusal::Model(ModelError::Indefinite { .. })), "{error}");
    assert_eq!(client.active_model().unwrap(), None);

    let mut stiff = configuration(&Robot::paper()).unwrap();
    stiff.joints[0].position_gain_a_per_count = 0.384;
    let error = client.prepare(&stiff, Pose::Known, false).unwrap_err();
    assert!(error.to_string().contains("limit"), "{error}");

    let error = client.load_trajectory(&armid::trajectory_file::paper(1.0).unwrap()).unwrap_err();
    assert!(error.to_string().contains("speed"), "{error}");
}

#[test]
fn the_pose_must_be_known() {
    let mut client = Client::connect(Box::new(simulated())).unwrap();
    let error = client.prepare(&configuration(&Robot::paper()).unwrap(), Pose::Known, false).unwrap_err();
    assert!(matches!(error, SessionError::PoseUnknown));
    assert!(error.to_string().contains("--pose"));
}

/// What happens on the way.
#[derive(Clone, Copy)]
enum Trouble {
    /// Every so many bytes from the board, one is damaged and one lost.
    Noise(u32),
    /// After so many bytes from the board the connection breaks.
    Breaks(u32),
    /// After so many bytes from the board nothing comes any more.
    FallsSilent(u32),
}

/// A link to the simulated board with trouble on it, once armed.
struct Troubled {
    board: SimulatedBoard,
    trouble: Trouble,
    armed: Rc<Cell<bool>>,
    bytes: u32,
}

impl Troubled {
    fn new(trouble: Trouble) -> (Self, Rc<Cell<bool>>) {
        let armed = Rc::new(Cell::new(false));
        (Self { board: simulated(), trouble, armed: armed.clone(), bytes: 0 }, armed)
    }
}

impl Link for Troubled {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        match self.trouble {
            Trouble::Breaks(after) if self.bytes > after => Err(self.broken()),
            _ => self.board.send(bytes),
        }
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        // Small pieces, as a slow wire gives them.
        let room = buffer.len().min(40);
        let count = self.board.receive(&mut buffer[..room], timeout)?;
        if !self.armed.get() {
            return Ok(count);
        }
        let before = self.bytes;
        self.bytes += count as u32;
        match self.trouble {
            Trouble::Noise(every) if count > 1 && before / every != self.bytes / every => {
                buffer[0] ^= 0x55;
                Ok(count - 1)
            }
            Trouble::Breaks(after) if self.bytes > after => Err(self.broken()),
            Trouble::FallsSilent(after) if self.bytes > after => {
                // Virtual time must go on, or nobody would ever give up.
                while self.board.receive(&mut [0; 4096], timeout)? > 0 {}
                Ok(0)
            }
            _ => Ok(count),
        }
    }

    fn now(&self) -> Duration {
        self.board.now()
    }

    fn name(&self) -> String {
        "troubled".into()
    }
}

impl Troubled {
    fn broken(&self) -> LinkError {
        LinkError::Broken { address: self.name(), reason: "unplugged".into() }
    }
}

#[test]
fn nothing_is_lost_on_a_noisy_link() {
    let (link, armed) = Troubled::new(Trouble::Noise(900));
    let mut client = ready(link);
    armed.set(true);
    let movement = run(&mut client, &POSITION);
    assert_eq!(movement.partial, None);
    assert_eq!(movement.samples.len() as u32, movement.planned_rows);
    assert!(movement.reread_rows > 5, "{} rows re-read", movement.reread_rows);
    assert_eq!(movement.differing_rows, 0, "damage is noticed, not believed");
    assert!(client.repeats() > 0 && client.frames().bad() > 10);
}

#[test]
fn a_board_that_goes_away_leaves_what_it_sent() {
    for trouble in [Trouble::Breaks(6000), Trouble::FallsSilent(6000)] {
        let (link, armed) = Troubled::new(trouble);
        let mut client = ready(link);
        armed.set(true);
        let movement = run(&mut client, &POSITION);
        assert!(movement.partial.is_some());
        assert!(movement.recording.is_none());
        let rows = movement.samples.len() as u32;
        assert!(rows > 100 && rows < movement.planned_rows, "{rows} of {}", movement.planned_rows);
    }
}

#[test]
fn a_fault_ends_the_movement_with_its_name_and_must_be_cleared() {
    // A robot ten times as heavy as the gains were chosen for strays from its reference.
    let robot = Robot::paper();
    let mut heavy = HiddenRobot::draw(&robot, SEED);
    heavy.f = heavy.f.map(|value| 40.0 * value);
    let mut client = ready(SimulatedBoard::new(&robot, heavy, SEED));
    client.load_trajectory(&nod()).unwrap();
    let movement = client.run(&POSITION, &mut |_| {}).unwrap();
    assert!(movement.partial.as_deref().is_some_and(|reason| reason.contains("limit")), "{:?}", movement.partial);
    let Mode::Fault(fault) = client.status().unwrap().mode else { panic!("no fault") };
    assert!(
        matches!(fault, Fault::FollowingError { .. } | Fault::CurrentLimit { .. } | Fault::OverSpeed { .. }),
        "{fault}"
    );

    let configuration = configuration(&robot).unwrap();
    let error = client.prepare(&configuration, Pose::Known, false).unwrap_err();
    assert!(matches!(error, SessionError::InFault(_)));
    assert!(error.to_string().contains("--clear-fault"), "{error}");
    client.prepare(&configuration, Pose::DefaultsTo([0.0; 2]), true).unwrap();
    assert_eq!(client.status().unwrap().mode, Mode::Idle);
}

/// A wire with nobody at the other end.
struct Silent {
    now: Duration,
}

impl Link for Silent {
    fn send(&mut self, _: &[u8]) -> Result<(), LinkError> {
        Ok(())
    }
    fn receive(&mut self, _: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        self.now += timeout;
        Ok(0)
    }
    fn now(&self) -> Duration {
        self.now
    }
    fn name(&self) -> String {
        "silent".into()
    }
}

#[test]
fn silence_is_reported_with_what_was_tried() {
    let error = Client::connect(Box::new(Silent { now: Duration::ZERO })).err().unwrap();
    assert!(matches!(error, ClientError::NoAnswer { attempts: 8, .. }));
    let text = error.to_string();
    assert!(text.contains("silent") && text.contains("8 attempts of 250 ms"), "{text}");
}

#[test]
fn the_same_bytes_travel_over_tcp() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let server = std::thread::spawn(move || {
        let mut board = simulated();
        let (mut stream, _) = listener.accept().unwrap();
        let mut buffer = [0; 512];
        while let Ok(count @ 1..) = stream.read(&mut buffer) {
            board.send(&buffer[..count]).unwrap();
            let count = board.receive(&mut buffer, Duration::ZERO).unwrap();
            stream.write_all(&buffer[..count]).unwrap();
        }
    });
    let mut client = ready(TcpLink::connect(&address).unwrap());
    assert_eq!(client.info().identity.board, "simulated");
    client.upload(&true_model()).unwrap();
    client.command(Request::KeepAlive).unwrap();
    drop(client);
    server.join().unwrap();
    let error = TcpLink::connect(&address).unwrap_err();
    assert!(error.to_string().contains("check that the board or emulator is running"), "{error}");
}

#[test]
fn parameters_survive_a_restart_and_storing_never_meets_an_armed_board() {
    let flash = MemoryFlash::default();
    let switched_on = || simulated().with_flash(flash.clone());
    let mut client = ready(switched_on());
    client.upload(&true_model()).unwrap();
    // Just begun: 2.5 ms for the record.
    match client.command(Request::Arm) {
        Err(ClientError::Refused { refusal: Refusal::Storing, .. }) => {}
        other => panic!("{other:?}"),
    }
    client.arm().unwrap();
    assert_eq!(client.status().unwrap().mode, Mode::Armed);
    client.command(Request::Disarm).unwrap();
    let stored = client.wait_until_stored().unwrap();
    assert_eq!((stored.state, stored.model_crc), (StoreState::Stored, Some(true_model().crc())));

    let mut client = Client::connect(Box::new(switched_on())).unwrap();
    let status = client.status().unwrap();
    assert_eq!((status.stored, status.active_model_crc), (stored, stored.model_crc));
    assert_eq!(client.active_model().unwrap(), Some(true_model()));
    client.command(Request::ForgetParameters).unwrap();
    assert_eq!(client.wait_until_stored().unwrap().state, StoreState::Nothing);

    let status = Client::connect(Box::new(switched_on())).unwrap().status().unwrap();
    assert_eq!((status.stored.state, status.configuration_crc), (StoreState::Nothing, None));
}
