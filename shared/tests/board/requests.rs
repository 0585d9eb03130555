//! Requests: what is refused and why, replays, versions, configuration, models, trajectories.

use crate::rig::{PAPER_PERIOD_NS, Rig, configuration, exact_model, identity};
use shared::board::Board;
use shared::protocol::*;
use shared::trajectory::{Fourier, Harmonic, LimitError, Paper, Points, Quantity, Trajectory, check};

fn hello() -> Request {
    Request::Hello { protocol_version: PROTOCOL_VERSION }
}

#[test]
fn a_link_must_say_hello_first() {
    let mut board = Board::new(identity(), [PackedSample::EMPTY; 10]);
    let not_greeted = Reply::Refused(Refusal::NotGreeted);
    assert_eq!(board.handle(Link::Usb, 1, &Request::Status), not_greeted);
    let Reply::Info(info) = board.handle(Link::Usb, 1, &hello()) else { panic!() };
    assert_eq!((info.protocol_version, info.identity, info.recording_capacity), (PROTOCOL_VERSION, identity(), 10));
    assert_eq!((info.robot_identity, info.last_fault), (None, None));
    assert!(matches!(board.handle(Link::Usb, 2, &Request::Status), Reply::Status(_)));
    assert_eq!(board.handle(Link::Serial, 2, &Request::Status), not_greeted, "each link for itself");
}

#[test]
fn another_version_is_told_so_and_can_do_nothing() {
    let mut board = Board::new(identity(), [PackedSample::EMPTY; 10]);
    board.handle(Link::Usb, 1, &hello());
    let reply = board.handle(Link::Usb, 2, &Request::Hello { protocol_version: 200 });
    let firmware_version = identity().firmware_version;
    assert_eq!(reply, Reply::WrongVersion { board: PROTOCOL_VERSION, host: 200, firmware_version });
    assert_eq!(board.handle(Link::Usb, 3, &Request::Arm), Reply::Refused(Refusal::NotGreeted));
}

/// A request that arrives twice is carried out once, and answered twice alike.
#[test]
fn replays_do_nothing() {
    let mut rig = Rig::loaded(configuration());
    let mut board = rig.board.clone();
    board.handle(Link::Serial, 10, &hello());
    assert_eq!(board.handle(Link::Serial, 11, &Request::Arm), Reply::Done);
    let run = Request::Run { law: ControlLaw::Position, stream: false, settle_ns: 0 };
    let started = board.handle(Link::Serial, 12, &run);
    assert!(matches!(started, Reply::Started { movement: 1, .. }));
    for _ in 0..50 {
        board.tick(&rig.inputs());
    }
    assert_eq!(board.handle(Link::Serial, 12, &run), started, "not refused, not started anew");
    assert!(matches!(board.mode(), Mode::Approaching(_)));
    board.handle(Link::Serial, 13, &Request::Disarm);
    // What was delayed on the way comes too late.
    let stale = Reply::Refused(Refusal::StaleSequence { sequence: 11, last: 13 });
    assert_eq!(board.handle(Link::Serial, 11, &Request::Arm), stale);
    assert_eq!(board.mode(), Mode::Idle);
    // Numbers may be left out, and wrap.
    board.handle(Link::Serial, u32::MAX, &hello());
    assert_eq!(board.handle(Link::Serial, 5, &Request::Arm), Reply::Done);
    assert_eq!(board.mode(), Mode::Armed);
    // A hello is answered as often as it comes.
    assert!(matches!(rig.send(hello()), Reply::Info(_)));
}

#[test]
fn arming_needs_constants_pose_and_a_released_stop() {
    let mut rig = Rig::bare(configuration());
    assert_eq!(rig.refused(Request::Arm), Refusal::NotConfigured);
    assert_eq!(rig.refused(Request::SetPosition { position_rad: [0.0; 2] }), Refusal::NotConfigured);
    rig.configure();
    assert_eq!(rig.refused(Request::Arm), Refusal::PoseUnknown);
    for value in [f64::NAN, f64::INFINITY, 1.0e9] {
        let refusal = rig.refused(Request::SetPosition { position_rad: [0.0, value] });
        assert!(matches!(refusal, Refusal::BadPosition { joint: Joint::Third, .. }), "{refusal}");
    }
    rig.ok(Request::SetPosition { position_rad: [-0.3, 0.4] });
    // fix() of −0.3 · 13 725.5 and of 0.4 · −8546.6.
    assert_eq!(rig.status().position_counts, [-4117, -3418]);
    rig.ok(Request::Arm);
    assert!(matches!(rig.refused(Request::Arm), Refusal::WrongMode { mode: Mode::Armed }));
    assert!(matches!(rig.refused(Request::SetPosition { position_rad: [0.0; 2] }), Refusal::WrongMode { .. }));
}

#[test]
fn a_configuration_is_applied_whole_or_not_at_all() {
    let mut rig = Rig::bare(configuration());
    let meant = configuration();
    let parts = meant.parts();
    let names = [
        PartName::Joint(Joint::Second),
        PartName::Joint(Joint::Third),
        PartName::Common,
        PartName::MotionLimits,
        PartName::ModelRange,
    ];
    for (part, name) in parts.into_iter().zip(names) {
        let refusal = rig.refused(Request::ApplyConfiguration { crc: meant.crc() });
        assert_eq!(refusal, Refusal::MissingPart { part: name });
        rig.ok(Request::Configure(part));
    }
    let wrong = rig.refused(Request::ApplyConfiguration { crc: !meant.crc() });
    assert_eq!(wrong, Refusal::CrcMismatch { host: !meant.crc(), board: meant.crc() });
    assert_eq!(rig.board.configuration(), None);
    rig.ok(Request::ApplyConfiguration { crc: meant.crc() });
    assert_eq!(rig.board.configuration(), Some(&meant));
    assert_eq!(rig.status().configuration_crc, Some(meant.crc()));

    // Unstable: the whole is refused with the limit, and the old one stays.
    let mut stiff = meant;
    stiff.joints[1].position_gain_a_per_count = 0.095;
    let limit = 1.38e-3 * core::f64::consts::TAU / (1000.0 * 0.38e-3) / 0.25;
    rig.ok(Request::Configure(stiff.parts()[1]));
    match rig.refused(Request::ApplyConfiguration { crc: stiff.crc() }) {
        Refusal::Configuration(ConfigurationError::UnstableGain {
            joint: Joint::Third,
            gain_a_per_count: 0.095,
            limit_a_per_count,
            cause: GainLimitCause::Damping,
        }) => assert!((limit_a_per_count - limit).abs() < 1.0e-12, "{limit_a_per_count} {limit}"),
        other => panic!("{other}"),
    }
    assert_eq!(rig.board.configuration(), Some(&meant));
    stiff.joints[1].position_gain_a_per_count = 0.091;
    rig.ok(Request::Configure(stiff.parts()[1]));
    rig.ok(Request::ApplyConfiguration { crc: stiff.crc() });
}

#[test]
fn another_robot_makes_pose_trajectory_and_model_worthless_other_gains_only_the_trajectory() {
    let mut rig = Rig::loaded(configuration());
    rig.upload(exact_model());
    let same = rig.configuration.crc();
    rig.ok(Request::ApplyConfiguration { crc: same });
    let status = rig.status();
    assert_eq!((status.trajectory, status.pose_known), (TrajectoryPhase::Accepted, true), "nothing changed");

    rig.configuration.joints[0].position_gain_a_per_count = 0.03;
    rig.configure();
    let status = rig.status();
    assert_eq!((status.trajectory, status.pose_known), (TrajectoryPhase::Empty, true));
    assert_eq!(status.active_model_crc, Some(exact_model().crc()));

    rig.configuration.joints[0].gear_ratio = 100.0;
    rig.configure();
    let status = rig.status();
    assert_eq!((status.trajectory, status.pose_known), (TrajectoryPhase::Empty, false));
    assert_eq!((status.active_model_crc, status.staged_model_crc), (None, None));
    let crc = exact_model().crc();
    let board = rig.configuration.robot_identity();
    let refusal = rig.refused(Request::StageModel { model: exact_model(), crc });
    assert_eq!(refusal, Refusal::Model(ModelError::OtherRobot { model: exact_model().robot_identity, board }));
}

#[test]
fn nothing_is_configured_while_armed() {
    let mut rig = Rig::armed(configuration());
    let part = configuration().parts()[0];
    let crc = configuration().crc();
    let mode = Mode::Armed;
    assert_eq!(rig.refused(Request::Configure(part)), Refusal::WrongMode { mode });
    assert_eq!(rig.refused(Request::ApplyConfiguration { crc }), Refusal::WrongMode { mode });
}

/// Every way a model can be wrong; none of them touches the models held.
#[test]
fn bad_models_are_refused_one_by_one() {
    let mut rig = Rig::loaded(configuration());
    rig.upload(exact_model());
    let mut refused = |change: fn(&mut Model)| {
        let mut model = exact_model();
        change(&mut model);
        let Refusal::Model(error) = rig.refused(Request::StageModel { model, crc: model.crc() }) else { panic!() };
        let status = rig.status();
        assert_eq!(status.staged_model_crc, Some(exact_model().crc()));
        assert_eq!(status.active_model_crc, Some(exact_model().crc()));
        error
    };
    assert!(matches!(refused(|model| model.robot_identity ^= 1), ModelError::OtherRobot { .. }));
    assert!(matches!(refused(|model| model.f[3] = f64::NAN), ModelError::NotFinite { number: 4, .. }));
    assert!(matches!(refused(|model| model.f[8] = f64::INFINITY), ModelError::NotFinite { number: 9, .. }));
    assert!(matches!(
        refused(|model| model.f[8] = 1000.0),
        ModelError::OutOfRange { number: 9, value: 1000.0, high, .. } if (high - 25.2).abs() < 0.01
    ));
    assert!(matches!(refused(|model| model.f[0] = -0.5), ModelError::JointInertia { value: -0.5 }));
    assert!(matches!(
        refused(|model| model.f[1] = 4.0),
        ModelError::Indefinite { determinant, .. } if determinant < 0.0
    ));
    assert!(matches!(
        refused(|model| model.coulomb_friction_nm[1] = -0.1),
        ModelError::Friction { joint: Joint::Third, value: -0.1 }
    ));
    assert!(matches!(
        refused(|model| model.viscous_friction_nm_s_per_rad[0] = f64::NAN),
        ModelError::Friction { joint: Joint::Second, .. }
    ));
    let error = refused(|model| model.compensation[1].ripple_share = 0.6);
    assert!(matches!(error, ModelError::Compensation { joint: Joint::Third, value: 0.6, high: 0.5, .. }));
    let text = error.to_string();
    assert!(text.contains("ripple_share of joint 3 is 0.6") && text.contains("leave it out"), "{text}");
    let error = refused(|model| model.compensation[0].cogging_nm = f32::NAN);
    assert!(matches!(error, ModelError::Compensation { joint: Joint::Second, value, .. } if value.is_nan()));
    let error = refused(|model| model.compensation[0].stribeck_velocity_rad_s = 0.0);
    assert!(error.to_string().contains("stribeck_velocity_rad_s"), "{error}");
}

/// What arrives damaged, is committed by the wrong name, or never arrives, changes nothing.
#[test]
fn a_model_is_swapped_whole_or_not_at_all() {
    let mut rig = Rig::loaded(configuration());
    let first = exact_model();
    assert_eq!(rig.refused(Request::CommitModel { crc: first.crc() }), Refusal::NoModel);
    let damaged = rig.refused(Request::StageModel { model: first, crc: !first.crc() });
    assert_eq!(damaged, Refusal::CrcMismatch { host: !first.crc(), board: first.crc() });
    assert_eq!(rig.refused(Request::CommitModel { crc: first.crc() }), Refusal::NoModel);

    let held = |slot, model: Option<Model>| Reply::Model { slot, model, crc: model.map_or(0, |model| model.crc()) };
    let staged = rig.ok(Request::StageModel { model: first, crc: first.crc() });
    assert_eq!(staged, held(ModelSlot::Staged, Some(first)));
    assert_eq!(rig.ok(Request::ReadModel(ModelSlot::Active)), held(ModelSlot::Active, None));
    assert_eq!(rig.board.active_model(), None, "staged is not active");
    let committed = rig.ok(Request::CommitModel { crc: first.crc() });
    assert_eq!(committed, held(ModelSlot::Active, Some(first)));
    rig.ok(Request::CommitModel { crc: first.crc() });

    // A second one, interrupted between the phases: the first stays in force.
    let mut second = first;
    second.f[6] += 0.1;
    rig.ok(Request::StageModel { model: second, crc: second.crc() });
    assert!(matches!(rig.refused(Request::CommitModel { crc: first.crc() }), Refusal::CrcMismatch { .. }));
    assert_eq!(rig.ok(Request::ReadModel(ModelSlot::Active)), held(ModelSlot::Active, Some(first)));
    assert_eq!(rig.ok(Request::ReadModel(ModelSlot::Staged)), held(ModelSlot::Staged, Some(second)));
    rig.ok(Request::CommitModel { crc: second.crc() });
    assert_eq!(rig.board.active_model(), Some(&second));
}

#[test]
fn computed_torque_needs_a_model_and_may_get_another_while_it_runs() {
    let mut rig = Rig::armed(configuration());
    let refusal = rig.refused(Request::Run { law: ControlLaw::ComputedTorque, stream: false, settle_ns: 0 });
    assert_eq!(refusal, Refusal::NoModel);
    rig.upload(exact_model());
    rig.run(ControlLaw::ComputedTorque);
    rig.until(|mode| matches!(mode, Mode::Running(_)));
    let mut other = exact_model();
    other.f[6] += 0.1;
    rig.upload(other);
    assert_eq!(rig.board.active_model(), Some(&other));
    rig.until(|mode| matches!(mode, Mode::Holding(_)));
    // The recording's model is the one it began with.
    assert_eq!(rig.recording_info().model_crc, Some(exact_model().crc()));
    rig.upload(exact_model());
    assert_eq!(rig.board.active_model(), Some(&exact_model()));
}

#[test]
fn what_was_kept_over_a_restart_is_checked_again() {
    let mut board = Board::new(identity(), [PackedSample::EMPTY; 10]);
    board.restore(&configuration(), Some(&exact_model())).unwrap();
    assert_eq!((board.configuration(), board.active_model()), (Some(&configuration()), Some(&exact_model())));
    let mut rotten = configuration();
    rotten.joints[0].gear_ratio = f64::NAN;
    let mut board = Board::new(identity(), [PackedSample::EMPTY; 10]);
    assert!(matches!(board.restore(&rotten, None), Err(Refusal::Configuration(_))));
    assert_eq!(board.configuration(), None);
    let mut model = exact_model();
    model.f[0] = f64::NAN;
    assert!(matches!(board.restore(&configuration(), Some(&model)), Err(Refusal::Model(_))));
    assert_eq!((board.configuration(), board.active_model()), (Some(&configuration()), None));
}

/// Sends a trajectory in the parts it travels in.
fn load(rig: &mut Rig, trajectory: &Trajectory) -> Result<TrajectoryState, Refusal> {
    let parts: Vec<TrajectoryPart> = match trajectory {
        Trajectory::Paper(paper) => vec![TrajectoryPart::Paper(*paper)],
        Trajectory::Fourier(fourier) => vec![TrajectoryPart::Fourier(fourier.clone())],
        Trajectory::Points(points) => {
            let all = points.points_rad();
            let begin = TrajectoryPart::BeginPoints { interval_ns: points.interval_ns(), points: all.len() as u16 };
            let chunks = all.chunks(POINTS_PER_FRAME).enumerate().map(|(index, chunk)| TrajectoryPart::Points {
                from: (index * POINTS_PER_FRAME) as u16,
                points_rad: chunk.iter().copied().collect(),
            });
            std::iter::once(begin).chain(chunks).collect()
        }
    };
    for part in parts {
        match rig.send(Request::LoadTrajectory(part)) {
            Reply::Refused(refusal) => return Err(refusal),
            reply => assert!(matches!(reply, Reply::Trajectory(_))),
        }
    }
    Ok(rig.checked())
}

/// A cosine every 20 points.
fn spline(points: usize, interval_ns: u64) -> Trajectory {
    let angle = |index: usize| index as f32 * core::f32::consts::TAU / 20.0;
    let points: Vec<[f32; 2]> =
        (0..points).map(|index| [-0.5 + 0.2 * angle(index).cos(), 0.5 + 0.15 * (2.0 * angle(index)).cos()]).collect();
    Trajectory::Points(Points::new(interval_ns, &points).unwrap())
}

fn fourier(period_ns: u64, amplitude_rad: f32, harmonics: usize) -> Trajectory {
    let harmonic = |order: usize| Harmonic {
        cosine_rad: [amplitude_rad / order as f32, 0.5 * amplitude_rad],
        sine_rad: [0.3 * amplitude_rad, -amplitude_rad / order as f32],
    };
    Trajectory::Fourier(Fourier {
        period_ns,
        repeats: 2,
        fade_ns: period_ns / 4,
        centre_rad: [-0.7, 0.7],
        harmonics: (1..=harmonics).map(harmonic).collect(),
    })
}

/// The check spread over ticks and the one all at once must agree.
#[test]
fn the_boards_check_gives_the_margins_of_the_hosts() {
    let mut rig = Rig::configured(configuration());
    let counts_per_rad = rig.configuration.joints.map(|joint| joint.counts_per_rad() as f32);
    let limits = rig.configuration.motion_limits;
    let (mut accepted, mut refused) = (0, 0);
    for trajectory in [
        Trajectory::Paper(Paper { period_ns: PAPER_PERIOD_NS }),
        Trajectory::Paper(Paper { period_ns: 2_000_000_000 }),
        Trajectory::Paper(Paper { period_ns: 1_000_000_000 }),
        fourier(3_000_000_000, 0.1, 5),
        fourier(3_000_000_000, 0.4, 5),
        fourier(3_000_000_000, 0.02, 8),
        spline(121, 60_000_000),
        spline(21, 200_000_000),
        spline(21, 20_000_000),
    ] {
        let expected = check(&trajectory, &limits, counts_per_rad, 700_000);
        match (load(&mut rig, &trajectory).unwrap(), expected) {
            (TrajectoryState::Accepted { margins, rows }, Ok(expected)) => {
                accepted += 1;
                assert_eq!(u64::from(rows), trajectory.record_periods(700_000));
                for (found, expected) in margins.rows.iter().zip(&expected.rows) {
                    assert_eq!(
                        (found.quantity, found.joint, found.limit),
                        (expected.quantity, expected.joint, expected.limit)
                    );
                    // The speed at the end is zero or as good as zero in both.
                    let scale = expected.peak.abs().max(expected.limit.abs() * 1.0e-2).max(1.0e-3);
                    let gap = (found.peak - expected.peak).abs() / scale;
                    assert!(gap < 3.0e-4, "{trajectory:?}\nboard {found}\nhost  {expected}");
                }
            }
            (TrajectoryState::Refused(LimitError::Exceeded(found)), Err(LimitError::Exceeded(expected))) => {
                assert_eq!((found.quantity, found.joint), (expected.quantity, expected.joint));
                assert!((found.peak / expected.peak - 1.0).abs() < 3.0e-4);
                refused += 1;
            }
            (found, expected) => panic!("{trajectory:?}\nboard {found:?}\nhost {expected:?}"),
        }
    }
    assert_eq!((accepted, refused), (5, 4));
}

#[test]
fn a_spline_sent_in_parts_is_followed() {
    let mut rig = Rig::configured(configuration());
    let trajectory = spline(41, 70_000_000);
    assert!(matches!(load(&mut rig, &trajectory), Ok(TrajectoryState::Accepted { rows: 4000, .. })));
    rig.ok(Request::Arm);
    rig.movement(ControlLaw::Position);
    let samples = rig.recording();
    assert_eq!(samples.len(), 4000);
    for (row, sample) in (0_u64..).zip(&samples) {
        let exact = trajectory.reference::<f64>(row * 700_000).position_rad;
        for (joint, constants) in rig.configuration.joints.iter().enumerate() {
            let gap = exact[joint] * constants.counts_per_rad() - f64::from(sample.reference_counts[joint]);
            assert!(gap.abs() < 1.01, "row {row}: {gap}");
        }
    }
}

#[test]
fn trajectories_that_cannot_be_run_are_refused_by_name() {
    let mut rig = Rig::configured(configuration());
    let mut refused = |part| rig.refused(Request::LoadTrajectory(part));
    let paper = |period_ns| TrajectoryPart::Paper(Paper { period_ns });
    assert_eq!(refused(paper(7_350_700_000)), Refusal::TooManyRows { rows: 10_501, capacity: 10_500 });
    assert!(matches!(refused(paper(u64::MAX)), Refusal::TooManyRows { .. }));
    let too_fine = Refusal::TooFine { shortest_ns: 0, least_ns: 14_000_000 };
    assert_eq!(refused(paper(0)), too_fine);
    // As fast as it is recorded: it would look like standing still.
    assert!(matches!(refused(paper(1_400_000)), Refusal::TooFine { shortest_ns: 700_000, .. }));
    let Trajectory::Fourier(mut series) = fourier(1_000_000_000, 0.1, 2) else { panic!() };
    series.harmonics[1].sine_rad[0] = f32::NAN;
    let refusal = refused(TrajectoryPart::Fourier(series));
    assert!(matches!(refusal, Refusal::Limit(LimitError::NotFinite { .. })), "{refusal}");

    let points = |from, count: usize| TrajectoryPart::Points {
        from,
        points_rad: std::iter::repeat_n([0.0; 2], count).collect(),
    };
    let out_of_order = |from, received, points| Refusal::PointsOutOfOrder { from, received, points };
    assert_eq!(refused(points(0, 1)), out_of_order(0, 0, 0), "not announced");
    let begin = |points| TrajectoryPart::BeginPoints { interval_ns: 100_000_000, points };
    assert_eq!(refused(begin(257)), Refusal::Limit(LimitError::TooManyPoints { points: 257 }));
    assert_eq!(refused(begin(1)), Refusal::Limit(LimitError::TooFewPoints { points: 1 }));
    rig.ok(Request::LoadTrajectory(begin(30)));
    rig.ok(Request::LoadTrajectory(points(0, 20)));
    let mut refused = |part| rig.refused(Request::LoadTrajectory(part));
    assert_eq!(refused(points(0, 20)), out_of_order(0, 20, 30));
    assert_eq!(refused(points(21, 5)), out_of_order(21, 20, 30));
    assert_eq!(refused(points(20, 11)), out_of_order(20, 20, 30), "more than announced");
    assert_eq!(rig.status().trajectory, TrajectoryPhase::Loading);
    rig.ok(Request::LoadTrajectory(points(20, 10)));
    assert!(matches!(rig.checked(), TrajectoryState::Accepted { .. }), "what was refused did no harm");
}

#[test]
fn a_movement_needs_an_accepted_trajectory_and_an_armed_board() {
    let run = || Request::Run { law: ControlLaw::Position, stream: false, settle_ns: 0 };
    let mut rig = Rig::configured(configuration());
    assert_eq!(rig.refused(run()), Refusal::WrongMode { mode: Mode::Idle });
    rig.ok(Request::Arm);
    assert_eq!(rig.refused(run()), Refusal::NoTrajectory);
    rig.ok(Request::LoadTrajectory(TrajectoryPart::Paper(Paper { period_ns: PAPER_PERIOD_NS })));
    assert_eq!(rig.refused(run()), Refusal::NoTrajectory, "still being checked");
    rig.checked();
    let endless = Request::Run { law: ControlLaw::Position, stream: false, settle_ns: u64::MAX };
    assert!(matches!(rig.refused(endless), Refusal::SettleTooLong { .. }));
    rig.ok(run());
    assert!(matches!(rig.refused(run()), Refusal::WrongMode { mode: Mode::Approaching(_) }));
    let load = Request::LoadTrajectory(TrajectoryPart::Paper(Paper { period_ns: PAPER_PERIOD_NS }));
    assert!(matches!(rig.refused(load), Refusal::WrongMode { .. }), "not under a movement's feet");
    let begin = TrajectoryPart::BeginPoints { interval_ns: 1, points: 2 };
    assert!(matches!(rig.refused(Request::LoadTrajectory(begin)), Refusal::WrongMode { .. }));
}

#[test]
fn a_limit_that_is_broken_names_quantity_and_time() {
    let mut rig = Rig::configured(configuration());
    let trajectory = Trajectory::Paper(Paper { period_ns: 1_500_000_000 });
    let Ok(TrajectoryState::Refused(LimitError::Exceeded(margin))) = load(&mut rig, &trajectory) else { panic!() };
    // (π/4)(4π/T) = 6.6 rad/s at joint 3 comes after joint 2's 3.3 rad/s beyond 2.7.
    assert_eq!((margin.quantity, margin.joint, margin.limit), (Quantity::Speed, 0, 2.7));
    assert!((margin.peak - 3.29).abs() < 0.01);
}
