//! What judging candidates costs, against samples, candidates and cores: `cargo bench -p armid`.

use std::hint::black_box;

use armid::board_setup::configuration;
use armid::capture::{self, Circumstances};
use armid::client::{Client, MovementPlan, Pose};
use armid::hidden_robot::HiddenRobot;
use armid::identify::{Experiment, SEARCH_LANES};
use armid::link::SimulatedBoard;
use armid::recording::{Mode, Recording};
use armid::robot::Robot;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use shared::plant::Plant;
use shared::protocol::ControlLaw;

const SEED: u64 = 3;

/// The paper's movement in `period_s`, recorded on a hidden robot.
fn record(robot: &Robot, period_s: f64) -> Recording {
    let mut client = Client::connect(Box::new(SimulatedBoard::hidden(robot, SEED))).unwrap();
    client.prepare(&configuration(robot).unwrap(), Pose::DefaultsTo([0.0; 2]), false).unwrap();
    client.load_trajectory(&armid::trajectory_file::paper(period_s).unwrap()).unwrap();
    let plan = MovementPlan { law: ControlLaw::Position, settle_ns: 500_000_000 };
    let movement = client.run(&plan, &mut |_| {}).unwrap();
    let board = client.info().clone();
    let circumstances =
        Circumstances { robot, mode: Mode::P, trajectory: "paper".into(), board: board.clone(), seed: Some(SEED) };
    capture::recording(&movement, &circumstances, "run.csv".into())
}

/// Robots that differ a little.
fn plants(robot: &Robot, count: usize) -> Vec<Plant<f64>> {
    let hidden = HiddenRobot::draw(robot, SEED).plant(robot);
    (0..count)
        .map(|index| {
            let mut plant = hidden;
            plant.arm.f[6] += 1e-4 * index as f64;
            plant
        })
        .collect()
}

fn objective(criterion: &mut Criterion) {
    let robot = Robot::paper();
    let recording = record(&robot, 3.65);
    let experiment = Experiment::new(&robot, std::slice::from_ref(&recording)).unwrap();

    let mut group = criterion.benchmark_group("samples");
    for period_s in [3.65, 5.0, 7.0] {
        let recording = record(&robot, period_s);
        let experiment = Experiment::new(&robot, std::slice::from_ref(&recording)).unwrap();
        let plants = plants(&robot, 4 * SEARCH_LANES);
        group.throughput(Throughput::Elements((plants.len() * experiment.samples()) as u64));
        group.bench_function(BenchmarkId::from_parameter(experiment.samples()), |bencher| {
            bencher.iter(|| experiment.search_objectives_counts2(black_box(&plants)));
        });
    }
    group.finish();

    let mut group = criterion.benchmark_group("candidates");
    for count in [1, SEARCH_LANES, 2 * SEARCH_LANES, 8 * SEARCH_LANES] {
        let plants = plants(&robot, count);
        group.throughput(Throughput::Elements(count as u64));
        group.bench_function(BenchmarkId::new("search", count), |bencher| {
            bencher.iter(|| experiment.search_objectives_counts2(black_box(&plants)));
        });
        group.bench_function(BenchmarkId::new("double precision", count), |bencher| {
            bencher.iter(|| experiment.objectives_counts2(black_box(&plants)));
        });
    }
    group.finish();

    let mut group = criterion.benchmark_group("cores");
    let plants = plants(&robot, 16 * SEARCH_LANES);
    let mut cores = 1;
    while cores <= std::thread::available_parallelism().map_or(1, usize::from) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(cores).build().unwrap();
        group.throughput(Throughput::Elements(plants.len() as u64));
        group.bench_function(BenchmarkId::from_parameter(cores), |bencher| {
            bencher.iter(|| pool.install(|| experiment.search_objectives_counts2(black_box(&plants))));
        });
        cores *= 2;
    }
    group.finish();
}

criterion_group!(benches, objective);
criterion_main!(benches);
