//! Messages of every kind, at their longest and at random.

use proptest::prelude::*;
use shared::load::{LoadEstimate, LoadNews, LoadSettings, Rejected};
use shared::protocol::*;
use shared::trajectory::{
    Fourier, Harmonic, LimitError, MAX_HARMONICS, Margin, Margins, MotionLimits, Paper, Part, Quantity,
};

pub fn model() -> Model {
    Model {
        robot_identity: u32::MAX,
        f: shared::arm::REFERENCE_F,
        viscous_friction_nm_s_per_rad: [0.817e-3, 1.38e-3],
        coulomb_friction_nm: [0.124, 0.146],
        compensation: [JointCompensation::NONE; 2],
    }
}

/// Effects of joint 2, every number another.
pub fn compensation() -> JointCompensation {
    JointCompensation {
        torque_offset_nm: 0.03,
        torque_constant_change: -0.05,
        viscous_asymmetry_nm_s_per_rad: 4e-4,
        quadratic_nm_s2_per_rad2: 5e-6,
        stribeck_nm: -0.04,
        stribeck_velocity_rad_s: 12.0,
        stribeck_sharpness: 0.5,
        load_friction_coefficient: 0.06,
        motor_inertia_kg_m2: 2e-4,
        position_friction_nm: 0.02,
        position_friction_order: 2.0,
        position_friction_phase_rad: -3.1,
        ripple_share: 0.07,
        ripple_order: 6.0,
        ripple_phase_rad: 1.0,
        cogging_nm: 0.01,
        cogging_order: 11.0,
        cogging_phase_rad: 2.0,
        spring_nm: 3.0,
        spring_angle_rad: 0.25,
    }
}

pub fn configuration() -> Configuration {
    let joint = JointConstants {
        gear_ratio: 107.8,
        counts_per_rev: 800.0,
        torque_constant_nm_per_a: 0.25,
        current_limit_a: 12.0,
        position_gain_a_per_count: 0.036,
        lead: 0.0,
        viscous_friction_nm_s_per_rad: 0.817e-3,
        coulomb_friction_nm: 0.124,
        least_motor_inertia_kg_m2: 1.0e-4,
        following_error_limit_counts: 3000.0,
        speed_limit_rad_s: 5.0,
        over_current_limit_a: 15.0,
        current_scale: CurrentScale::symmetric(15.0),
    };
    Configuration {
        joints: [joint, JointConstants { gear_ratio: -53.7, counts_per_rev: 1000.0, ..joint }],
        common: LoopConstants {
            gravity_m_s2: 9.81,
            loop_period_ns: 700_000,
            record_period_ns: 700_000,
            command_delay_ns: 30_000,
            link_timeout_ns: 1_000_000_000,
            current_limit_time_ns: 200_000_000,
            stop_time_ns: 200_000_000,
            computed_torque: ComputedTorqueConstants {
                bandwidth_rad_s: 150.0,
                damping_ratio: 1.0,
                observer_bandwidth_rad_s: 400.0,
                friction_switch_motor_rad_s: 0.5,
            },
        },
        motion_limits: MotionLimits::reference_robot(),
        model_range: ModelRange::default(),
    }
}

/// Every request, with the longest contents it can have.
pub fn longest_requests() -> Vec<Request> {
    let mut requests = vec![
        Request::Hello { protocol_version: u8::MAX },
        Request::Status,
        Request::KeepAlive,
        Request::ApplyConfiguration { crc: u32::MAX },
        Request::SetPosition { position_rad: [f64::MIN, f64::MAX] },
        Request::Arm,
        Request::Disarm,
        Request::LoadTrajectory(TrajectoryPart::Paper(Paper { period_ns: u64::MAX })),
        Request::LoadTrajectory(TrajectoryPart::Fourier(Fourier {
            period_ns: u64::MAX,
            repeats: u32::MAX,
            fade_ns: u64::MAX,
            centre_rad: [f32::MAX; 2],
            harmonics: [Harmonic { cosine_rad: [1.5; 2], sine_rad: [-1.5; 2] }; MAX_HARMONICS].into_iter().collect(),
        })),
        Request::LoadTrajectory(TrajectoryPart::BeginPoints { interval_ns: u64::MAX, points: u16::MAX }),
        Request::LoadTrajectory(TrajectoryPart::Points {
            from: u16::MAX,
            points_rad: [[1.25_f32; 2]; POINTS_PER_FRAME].into_iter().collect(),
        }),
        Request::ReadTrajectory,
        Request::Run { law: ControlLaw::ComputedTorque, stream: true, settle_ns: u64::MAX },
        Request::Stop,
        Request::RecordingInfo,
        Request::ReadRecording { from: u32::MAX, count: u16::MAX },
        Request::StageModel { model: model(), crc: u32::MAX },
        Request::StageModel { model: Model { compensation: [compensation(); 2], ..model() }, crc: u32::MAX },
        Request::CommitModel { crc: u32::MAX },
        Request::ReadModel(ModelSlot::Active),
        Request::ClearFault,
        Request::ForgetParameters,
        Request::IdentifyLoad(LoadSettings {
            collect_rows: u16::MAX,
            ..LoadSettings::known_grasp(2.5, 0.4318, [-0.02, -0.53])
        }),
        Request::ForgetLoad,
        Request::UseLoad(longest_estimate()),
        Request::ReadLoad,
    ];
    requests.extend(configuration().parts().map(Request::Configure));
    requests
}

pub fn longest_sample() -> Sample {
    Sample {
        index: u32::MAX,
        reference_counts: [i32::MIN; 2],
        error_counts: [i16::MIN; 2],
        current_code: [4095; 2],
        command_code: [4095; 2],
    }
}

fn longest_estimate() -> LoadEstimate {
    LoadEstimate { mass_kg: 1.72, standard_error_kg: 0.03, rows: u16::MAX, ..LoadEstimate::NONE }
}

/// Every reply and every other message of the board, with the longest contents it can have.
pub fn longest_board_messages() -> Vec<BoardMessage> {
    let text = "x".repeat(24);
    let short = &text[..16];
    let fault = Fault::CurrentLimit { joint: Joint::Third, limit_a: 12.0, held_ns: u64::MAX };
    let mut limits = LimitsActive::NONE;
    ActiveLimit::ALL.into_iter().for_each(|limit| limits.insert(limit));
    let recording = RecordingInfo {
        movement: u32::MAX,
        rows: u32::MAX,
        planned_rows: u32::MAX,
        ended: Some(EndedBy::Fault(fault)),
        limits_active: limits,
        configuration_crc: u32::MAX,
        model_crc: Some(u32::MAX),
    };
    let identity = BoardIdentity {
        firmware_version: short.parse().unwrap(),
        git_revision: text.parse().unwrap(),
        board: text.parse().unwrap(),
        chip_id: [0; 12],
        chip_revision: u16::MAX,
        reset_cause: ResetCause::Other,
    };
    let counters = LinkCounters {
        received: u32::MAX,
        bad_frames: u32::MAX,
        telemetry_dropped: u32::MAX,
        replies_dropped: u32::MAX,
    };
    let timing = Timing {
        cycles_per_second: u32::MAX,
        worst_tick_cycles: u32::MAX,
        worst_start_cycles: u32::MAX,
        best_start_cycles: u32::MAX,
        missed_deadlines: u32::MAX,
    };
    let margin = Margin {
        quantity: Quantity::EndSpeed,
        joint: 1,
        peak: 1.0,
        limit: 2.0,
        time_ns: shared::trajectory::LONGEST_MOVEMENT_NS,
    };
    let replies = vec![
        Reply::WrongVersion { board: u8::MAX, host: u8::MAX, firmware_version: short.parse().unwrap() },
        Reply::Info(Info {
            protocol_version: u8::MAX,
            identity,
            recording_capacity: u32::MAX,
            knot_capacity: u16::MAX,
            robot_identity: Some(u32::MAX),
            last_fault: Some(fault),
            timing,
            links: [counters; 2],
        }),
        Reply::Status(Status {
            mode: Mode::Fault(fault),
            tick: u64::MAX,
            position_counts: [i32::MIN; 2],
            pose_known: true,
            error_counts: [i32::MIN; 2],
            current_a: [f32::MIN; 2],
            emergency_stop: true,
            limits_active: limits,
            configuration_crc: Some(u32::MAX),
            active_model_crc: Some(u32::MAX),
            staged_model_crc: Some(u32::MAX),
            stored: StoredParameters {
                state: StoreState::Failed(StoreFailure::Controller { status: u32::MAX }),
                configuration_crc: Some(u32::MAX),
                model_crc: Some(u32::MAX),
                damaged_records: u8::MAX,
            },
            trajectory: TrajectoryPhase::Refused,
            recording,
        }),
        Reply::Done,
        Reply::Trajectory(TrajectoryState::Loading { received: u16::MAX, points: u16::MAX }),
        Reply::Trajectory(TrajectoryState::Accepted { margins: Margins { rows: [margin; 14] }, rows: u32::MAX }),
        Reply::Trajectory(TrajectoryState::Refused(LimitError::NotFinite {
            part: Part::Point(255),
            joint: 1,
            value: 1.0,
        })),
        Reply::Started { movement: u32::MAX, approach_ns: u64::MAX, rows: u32::MAX },
        Reply::Recording(recording),
        Reply::Rows(RecordingRows {
            movement: u32::MAX,
            from: u32::MAX,
            first_reference_counts: [i32::MIN; 2],
            rows: [PackedSample([0xFF; PACKED_SAMPLE_BYTES]); ROWS_PER_FRAME].into_iter().collect(),
        }),
        Reply::Model { slot: ModelSlot::Active, model: Some(model()), crc: u32::MAX },
        Reply::Model {
            slot: ModelSlot::Active,
            model: Some(Model { compensation: [compensation(); 2], ..model() }),
            crc: u32::MAX,
        },
        Reply::Refused(Refusal::WrongMode { mode: Mode::Fault(fault) }),
        Reply::Refused(Refusal::Storing),
        Reply::Refused(Refusal::LoadNeedsEveryTick { loop_ns: u64::MAX, record_ns: u64::MAX }),
        Reply::Load(LoadReport {
            settings_active: true,
            assumed_kg: 1.25,
            found: Some(longest_estimate()),
            collecting_tick: u64::MAX,
            searching_tick: u64::MAX,
            found_tick: u64::MAX,
            identifications: u32::MAX,
            rejections: u32::MAX,
            changes: u32::MAX,
        }),
        Reply::Refused(Refusal::Model(ModelError::OutOfRange { number: 9, value: 1.0, low: 2.0, high: 3.0 })),
        Reply::Refused(Refusal::Configuration(ConfigurationError::UnstableGain {
            joint: Joint::Third,
            gain_a_per_count: 1.0,
            limit_a_per_count: 0.5,
            cause: GainLimitCause::LeadBandwidth,
        })),
    ];
    let mut messages: Vec<_> =
        replies.into_iter().map(|reply| BoardMessage::Reply { sequence: u32::MAX, reply }).collect();
    messages.push(BoardMessage::Telemetry { movement: u32::MAX, sample: longest_sample() });
    messages.push(BoardMessage::Event(Event::Mode { tick: u64::MAX, mode: Mode::Fault(fault) }));
    messages.push(BoardMessage::Event(Event::Load {
        tick: u64::MAX,
        news: LoadNews::Rejected(Rejected::Inconsistent, longest_estimate()),
    }));
    messages
}

pub fn any_request() -> impl Strategy<Value = Request> {
    let fixed = proptest::sample::select(longest_requests());
    prop_oneof![
        3 => fixed,
        1 => any::<u8>().prop_map(|protocol_version| Request::Hello { protocol_version }),
        1 => any::<[f64; 2]>().prop_filter("NaN equals nothing", |p| p.iter().all(|v| !v.is_nan()))
            .prop_map(|position_rad| Request::SetPosition { position_rad }),
        1 => (any::<u32>(), any::<u16>()).prop_map(|(from, count)| Request::ReadRecording { from, count }),
        1 => (any::<bool>(), any::<u64>()).prop_map(|(stream, settle_ns)| Request::Run {
            law: ControlLaw::Position, stream, settle_ns
        }),
        1 => (any::<u16>(), proptest::collection::vec([-3.2_f32..3.2, -3.2_f32..3.2], 0..=POINTS_PER_FRAME))
            .prop_map(|(from, points)| Request::LoadTrajectory(TrajectoryPart::Points {
                from, points_rad: points.into_iter().collect()
            })),
    ]
}

pub fn any_sample() -> impl Strategy<Value = Sample> {
    (any::<u32>(), any::<[i32; 2]>(), any::<[i16; 2]>(), [0_u16..4096, 0_u16..4096], [0_u16..4096, 0_u16..4096])
        .prop_map(|(index, reference_counts, error_counts, current_code, command_code)| Sample {
            index,
            reference_counts,
            error_counts,
            current_code,
            command_code,
        })
}
