//! Position loop, its stability limit against simulated loops, and the laws a recording may have been made under.

mod robot;

use core::f64::consts::PI;

use proptest::prelude::*;
use robot::{DELAY_S, PERIOD_S, Robot, drives, largest, laws, plant, position_loop, rms};
use shared::arm::Pose;
use shared::control::{Cascade, Law, LawState, PositionLaw, PositionLoop, SampledLoop, SampledTiming, StabilityLimit};
use shared::drive::Drive;
use shared::plant::{Plant, State};

/// The reference robot's loops at 0.7 ms with 30 µs delay. The inertia is half of what the motor feels with the other
/// joint free, at the worst q3: that covers the coupling of the two loops.
fn sampled_loops(lead: f64) -> [SampledLoop; 2] {
    let drives = drives();
    [0, 1].map(|j| {
        let felt = |k: i32| {
            let inverse = plant().arm.inertia(&Pose::at([0.0, f64::from(k) * PI / 180.0])).inverse();
            1.0 / [inverse.d11, inverse.d22][j]
        };
        let least = (0..360).map(felt).fold(f64::INFINITY, f64::min);
        SampledLoop {
            period_s: PERIOD_S,
            command_delay_s: DELAY_S,
            viscous_friction_nm_s_per_rad: drives[j].viscous_friction_nm_s_per_rad,
            counts_per_rev: drives[j].counts_per_rev,
            least_motor_inertia_kg_m2: 0.5 * least / drives[j].gear_ratio.powi(2),
            lead,
        }
    })
}

fn nm_per_count(loops: [SampledLoop; 2]) -> [f64; 2] {
    loops.map(|sampled| sampled.stability_limit().nm_per_count())
}

#[test]
fn stability_limits_of_the_paper_s_robot_are_those_of_the_design() {
    // design.md §4 prints G < Bv 2π/(N Td) as 0.0181 and 0.0244 at 0.7 ms: Td = 355 µs, that is 5 µs of computing.
    let printed = nm_per_count(sampled_loops(0.0).map(|sampled| SampledLoop { command_delay_s: 5e-6, ..sampled }));
    assert!((printed[0] - 0.0181).abs() < 5e-5 && (printed[1] - 0.0244).abs() < 5e-5, "{printed:?}");
    // The default delay of 30 µs makes Td 380 µs, so both limits are 355/380 of that.
    let [joint2, joint3] = nm_per_count(sampled_loops(0.0));
    assert!((joint2 * 380.0 / 355.0 - printed[0]).abs() < 1e-12 && (joint3 * 380.0 / 355.0 - printed[1]).abs() < 1e-12);
}

#[test]
fn limit_is_the_same_for_any_inertia_where_there_is_no_lead() {
    for sampled in sampled_loops(0.0) {
        let limit = sampled.stability_limit();
        let heavy = SampledLoop { least_motor_inertia_kg_m2: 10.0 * sampled.least_motor_inertia_kg_m2, ..sampled };
        assert!(matches!(limit, StabilityLimit::Damping(_)), "{limit:?}");
        assert!((heavy.stability_limit().nm_per_count() / limit.nm_per_count() - 1.0).abs() < 1e-12);
    }
}

/// Rms speed in the first and in the last second of both loops holding the arm at `q3` after a small push, so small
/// that the loops are linear. Coulomb friction is off, the encoder is not rounded.
fn speed_after_a_push(gains: [f64; 2], lead: f64, q3: f64, seconds: usize) -> [f64; 2] {
    let mut plant = plant();
    plant.drives.iter_mut().for_each(|drive| drive.coulomb_friction_nm = 0.0);
    let mut robot = Robot::new(plant, laws(gains, lead), false, PERIOD_S);
    robot.step_s = 1e-4;
    let position = [-0.7, q3];
    robot.state = State { position_rad: position, velocity_rad_s: [0.003, -0.002] };
    // The reference at which the loop holds the arm there against gravity.
    let g = plant.arm.gravity_torque_nm(&Pose::at(position));
    let reference =
        [0, 1].map(|j| position[j] * plant.drives[j].counts_per_rad() + g[j] / plant.drives[j].gear_ratio / gains[j]);
    let second = (1.0 / PERIOD_S) as usize;
    let speeds: Vec<f64> = (0..seconds * second)
        .map(|_| {
            robot.tick(reference);
            robot.state.velocity_rad_s[0].hypot(robot.state.velocity_rad_s[1])
        })
        .collect();
    [rms(&speeds[..second]), rms(&speeds[speeds.len() - second..])]
}

#[test]
fn simulated_arm_is_stable_a_tenth_below_the_limit_and_not_a_tenth_above() {
    for q3 in [0.0, 1.6, 3.1] {
        let at = |share: f64| speed_after_a_push(nm_per_count(sampled_loops(0.0)).map(|g| share * g), 0.0, q3, 20);
        // A tenth of the viscous damping is left, or missing: rate 0.05 Bv/J with J at most 5.6 e-4 kg m² at the motor,
        // at least 0.073/s, so a factor of at least 4 over the 19 s between the windows.
        let ([before, after], [first, last]) = (at(0.9), at(1.1));
        assert!(after < before / 2.0, "q3 {q3}: {before} became {after}");
        assert!(last > first * 2.0, "q3 {q3}: {first} became {last}");
    }
}

#[test]
fn gains_that_hold_ten_counts_need_lead_at_the_record_period() {
    // design.md §4: 0.096 and 0.094 are violently unstable at 0.7 ms, and stable with a lead of 2.
    let gains = [0.096, 0.094];
    let refused = |lead| [0, 1].map(|j| sampled_loops(lead)[j].check_gain(gains[j]).is_err());
    assert_eq!((refused(0.0), refused(2.0)), ([true; 2], [false; 2]));
    let [first, last] = speed_after_a_push(gains, 2.0, 0.8, 5);
    assert!(last < 1e-3 * first, "{first} became {last}");
    let [first, last] = speed_after_a_push(gains, 0.0, 0.8, 5);
    assert!(last > 100.0 * 0.003 && first > 10.0 * 0.003, "{first} became {last}");
}

#[test]
fn both_joints_just_below_their_limits_with_lead_are_stable_together_at_every_q3() {
    for lead in [0.8, 1.2, 2.0, 5.0] {
        let gains = nm_per_count(sampled_loops(lead)).map(|limit| 0.97 * limit);
        for q3 in [-2.4, -1.6, -0.8, 0.0, 0.8, 1.6, 2.4, 3.2] {
            let [first, last] = speed_after_a_push(gains, lead, q3, 2);
            assert!(last < 1e-3 * first, "lead {lead}, q3 {q3}: {first} became {last}");
        }
    }
}

/// By how much a single axis' loop grows a tick, as the logarithm of its largest pole's magnitude.
///
/// The loop is linear in its four memories (position, speed, the command and the error before), so running the plant and
/// the law for one tick from each gives its map; squaring that 30 times is a simulation of a thousand million ticks.
fn growth_a_tick(sampled: &SampledLoop, gain_nm_per_count: f64) -> f64 {
    let drive = Drive {
        gear_ratio: 1.0,
        counts_per_rev: sampled.counts_per_rev,
        torque_constant_nm_per_a: 0.25,
        current_limit_a: f64::INFINITY,
        viscous_friction_nm_s_per_rad: sampled.viscous_friction_nm_s_per_rad,
        coulomb_friction_nm: 0.0,
        torque_offset_nm: 0.0,
    };
    let prepared = Plant::single_axis(sampled.least_motor_inertia_kg_m2, drive).prepare();
    let law = position_loop(gain_nm_per_count, sampled.lead);
    let one_tick = |[position, speed, command, error]: [f64; 4]| {
        let now = -position * drive.counts_per_rad();
        let new = law.command_a(now, error);
        let mut state = State { position_rad: [position, 0.0], velocity_rad_s: [speed, 0.0] };
        for (command, duration_s) in
            [(command, sampled.command_delay_s), (new, sampled.period_s - sampled.command_delay_s)]
        {
            for _ in 0..20 {
                state = prepared.step(&state, [drive.motor_torque_nm(command), 0.0], duration_s / 20.0);
            }
        }
        [state.position_rad[0], state.velocity_rad_s[0], new, now]
    };
    // Units in which all four are of one size.
    let error = drive.counts_per_rad();
    let unit = [1.0, 1.0 / sampled.period_s, error * gain_nm_per_count / 0.25, error];
    let mut map = [[0.0; 4]; 4];
    for column in 0..4 {
        let mut start = [0.0; 4];
        start[column] = unit[column];
        let end = one_tick(start);
        for row in 0..4 {
            map[row][column] = end[row] / unit[row];
        }
    }
    let (mut log, doublings) = (0.0, 30);
    for doubling in 0..doublings {
        let mut square = [[0.0; 4]; 4];
        for (i, row) in square.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry = (0..4).map(|k| map[i][k] * map[k][j]).sum();
            }
        }
        let size = largest(square.iter().flatten().copied());
        log += size.ln() / 2.0_f64.powi(doubling + 1);
        map = square.map(|row| row.map(|entry| entry / size));
    }
    log
}

/// A loop by its ratios: delay and lead in periods, and the share of its speed that viscous friction takes in a period.
fn loop_of(period_s: f64, late: f64, lead: f64, friction: f64) -> SampledLoop {
    let inertia = 5e-4;
    SampledLoop {
        period_s,
        command_delay_s: late * period_s,
        viscous_friction_nm_s_per_rad: friction * inertia / period_s,
        counts_per_rev: 1000.0,
        least_motor_inertia_kg_m2: inertia,
        lead,
    }
}

const LEADS: [f64; 10] = [0.0, 0.2, 0.45, 0.5, 0.55, 0.8, 1.0, 1.5, 2.0, 5.0];

#[test]
fn loop_with_the_least_inertia_is_stable_just_below_the_limit_and_unstable_just_above() {
    for period_s in [5e-5, 7e-4] {
        for late in [0.0, 0.043, 0.3, 0.7, 1.0] {
            for lead in LEADS {
                // The paper's robot takes 0.001 of the speed at 0.7 ms.
                for friction in [1e-4, 1e-3, 1e-2] {
                    let sampled = loop_of(period_s, late, lead, friction);
                    let limit = sampled.stability_limit();
                    let growth = |share: f64| growth_a_tick(&sampled, share * limit.nm_per_count());
                    assert!(growth(0.99) < 0.0, "{sampled:?} {limit:?} is not safe: {}", growth(0.99));
                    assert!(growth(1.01) > 0.0, "{sampled:?} {limit:?} forbids too much: {}", growth(1.01));
                }
            }
        }
    }
}

#[test]
fn limit_is_on_the_safe_side_for_heavy_friction_too() {
    for late in [0.0, 0.043, 0.3, 0.7, 1.0] {
        for lead in LEADS {
            for friction in [0.1, 0.5, 2.0] {
                let sampled = loop_of(PERIOD_S, late, lead, friction);
                let limit = sampled.stability_limit();
                for share in [0.1, 0.3, 0.6, 0.99] {
                    let growth = growth_a_tick(&sampled, share * limit.nm_per_count());
                    assert!(growth < 0.0, "{sampled:?} at {share} of {limit:?}: {growth}");
                }
            }
        }
    }
}

#[test]
fn lead_that_just_pays_for_the_delay_does_not_make_the_limit_infinite() {
    for late in [0.0, 0.043, 0.5, 1.0] {
        let limit = loop_of(PERIOD_S, late, 0.5 + late, 1e-3).stability_limit();
        assert!(limit.nm_per_count().is_finite(), "{limit:?}");
    }
}

proptest! {
    #[test]
    fn limit_grows_with_inertia_and_with_friction(
        (late, lead) in (0.0..1.0_f64, 0.0..4.0_f64),
        (friction, more) in (1e-4..0.1_f64, 1.0..5.0_f64),
    ) {
        let sampled = loop_of(PERIOD_S, late, lead, friction);
        // The damping formula is of first order in friction; what is left is of the order friction²/10.
        let limit = sampled.stability_limit().nm_per_count() * (1.0 - 1e-3);
        let inertia = more * sampled.least_motor_inertia_kg_m2;
        let heavier = SampledLoop { least_motor_inertia_kg_m2: inertia, ..sampled };
        prop_assert!(heavier.stability_limit().nm_per_count() >= limit);
        prop_assert!(loop_of(PERIOD_S, late, lead, more * friction).stability_limit().nm_per_count() >= limit);
    }
}

#[test]
fn gain_is_accepted_from_zero_up_to_but_not_including_the_limit() {
    for lead in [0.0, 2.0] {
        for sampled in sampled_loops(lead) {
            let limit = sampled.stability_limit().nm_per_count();
            for good in [0.0, 0.5 * limit, limit.next_down()] {
                assert_eq!(sampled.check_gain(good), Ok(()));
            }
            for bad in [limit, 2.0 * limit, -1e-9, f64::NAN, f64::INFINITY] {
                assert!(sampled.check_gain(bad).is_err(), "{bad}");
            }
        }
    }
}

#[test]
fn refusal_names_the_gain_the_limit_its_cause_and_a_remedy() {
    let sampled = sampled_loops(0.0)[0];
    let error = sampled.check_gain(0.25).unwrap_err();
    let message = error.to_string();
    let limit = format!("{:.5} N m/count", sampled.stability_limit().nm_per_count());
    for part in ["0.25000 N m/count", &limit, sampled.stability_limit().cause(), "lower the gain"] {
        assert!(message.contains(part), "{message:?} lacks {part:?}");
    }
    let with_lead = sampled_loops(2.0)[0].check_gain(50.0).unwrap_err();
    assert_eq!(with_lead.cause, StabilityLimit::LeadBandwidth(0.0).cause());
}

#[test]
fn cause_is_the_lead_only_where_friction_alone_would_allow_far_more() {
    // Leads of 0, just under and well over what pays for half a period of delay.
    let cause = |lead| loop_of(PERIOD_S, 0.0, lead, 1e-3).stability_limit().cause();
    let [friction, bandwidth] = [StabilityLimit::Damping(0.0), StabilityLimit::LeadBandwidth(0.0)].map(|l| l.cause());
    assert_eq!([0.0, 0.45, 0.5, 2.0].map(cause), [friction, friction, bandwidth, bandwidth]);
}

#[test]
fn loop_whose_numbers_make_no_sense_accepts_no_gain() {
    let good = sampled_loops(2.0)[0];
    for bad in [
        SampledLoop { command_delay_s: 1.01 * good.period_s, ..good },
        SampledLoop { command_delay_s: -1e-6, ..good },
        SampledLoop { command_delay_s: f64::NAN, ..good },
        SampledLoop { viscous_friction_nm_s_per_rad: f64::NAN, ..good },
        SampledLoop { least_motor_inertia_kg_m2: f64::NAN, ..good },
        SampledLoop { lead: f64::NAN, ..good },
        SampledLoop { lead: 0.0, viscous_friction_nm_s_per_rad: 0.0, ..good },
    ] {
        assert!(bad.check_gain(1e-6).is_err(), "{bad:?}");
    }
}

// The laws.

#[test]
fn loop_counts_as_faster_than_the_recording_only_where_ticks_fall_between_samples() {
    let timing = |loop_period_s| SampledTiming { record_period_s: 0.0007, loop_period_s, command_delay_s: 0.0 };
    for loop_period_s in [0.00035, 0.0001, 0.00005] {
        assert!(timing(loop_period_s).loop_is_faster_than_recording());
    }
    for loop_period_s in [0.0007, 0.000_699_999, 0.000_700_001] {
        assert!(!timing(loop_period_s).loop_is_faster_than_recording());
    }
}

const REFERENCE: [f64; 6] = [10.0, 13.0, 15.0, 14.0, 20.0, 20.0];
const ACTUAL: [f64; 6] = [4.0, 6.0, 11.0, 15.0, 16.0, 20.5];

#[test]
fn proportional_law_is_the_formula_of_the_design() {
    let mut law = LawState::new(Law::Proportional(PositionLoop { gain_a_per_count: 0.4, lead: 2.0 }));
    let mut previous = None;
    for (reference, actual) in REFERENCE.into_iter().zip(ACTUAL) {
        let error: f64 = reference - actual;
        // u = G (e + β (e − e_prev)); the first tick takes the past to have been like the present.
        let expected = 0.4 * (error + 2.0 * (error - previous.unwrap_or(error)));
        assert!((law.command_a(reference, actual) - expected).abs() < 1e-12);
        previous = Some(error);
    }
}

const CASCADE: Cascade<f64> =
    Cascade { position_gain_per_s: 160.0, velocity_gain: 240.0, counts_per_unit: 5000.0, period_s: 0.001 };

#[test]
fn cascade_is_a_position_loop_around_the_velocity_of_two_tick_means() {
    let mut law = LawState::new(Law::Cascade(CASCADE));
    // Before the first tick the axis stood where the first tick saw it.
    let position = |k: i32| ACTUAL[k.max(0) as usize] / 5000.0;
    for k in 0..6 {
        let velocity = (0.5 * (position(k) + position(k - 1)) - 0.5 * (position(k - 1) + position(k - 2))) / 0.001;
        let wanted = 160.0 * (REFERENCE[k as usize] / 5000.0 - position(k));
        let found = law.command_a(REFERENCE[k as usize], ACTUAL[k as usize]);
        assert!((found - 240.0 * (wanted - velocity)).abs() < 1e-9, "tick {k}");
    }
}

#[test]
fn law_that_takes_over_a_moving_motor_does_not_jump() {
    // A motor that follows at 8 counts a tick with a constant error of 25.
    let steady = |law: Law<f64>| {
        let mut fresh = LawState::new(law);
        let mut last = 0.0;
        for k in 0..20 {
            last = fresh.command_a(8.0 * f64::from(k) + 25.0, 8.0 * f64::from(k));
        }
        last
    };
    for law in [Law::Proportional(PositionLoop { gain_a_per_count: 0.4, lead: 2.0 }), Law::Cascade(CASCADE)] {
        let mut moving = LawState::moving(law, 25.0, 700.0, 8.0);
        for k in 0..4 {
            let actual = 700.0 + 8.0 * f64::from(k);
            assert!((moving.command_a(actual + 25.0, actual) - steady(law)).abs() < 1e-9, "tick {k}");
        }
    }
}

#[test]
fn lead_taken_out_of_a_law_is_returned_once_and_no_longer_acts() {
    let mut law = LawState::new(Law::Proportional(PositionLoop { gain_a_per_count: 0.4, lead: 2.0 }));
    assert_eq!((law.take_lead(), law.take_lead()), (2.0, 0.0));
    law.command_a(10.0, 0.0);
    assert_eq!(law.command_a(15.0, 0.0), 0.4 * 15.0);
    assert_eq!(LawState::new(Law::Cascade(CASCADE)).take_lead(), 0.0);
}
