//! The three stages as a state machine: rows in, news out, and work in bounded pieces.

use super::bundle::{Bundle, MODEL_UNKNOWNS, NUISANCES, START_ROWS, linear_load};
use super::learned::Learned;
use super::prior::gradient;
use super::quadratic::Quadratic;
use super::search::{LARGEST_NOISE_RATIO, Search};
use super::watch::Watch;
use super::window::Window;
use super::{LoadEstimate, LoadNews, LoadRow, LoadSetup, Rejected, Waiting};
use crate::arm::Load;

/// Time a step of one replica takes on the board, ns; for a simulated board. From the time a search takes on the emulated one.
pub const COST_NS_PER_REPLICA_STEP: u64 = 12_500;

/// Runs of the bundle at most, each about the load that the one before found; the first while the rows arrive. Three or
/// four mostly do, even where half the largest load is as much as the forearm and the first runs are far from linear.
const ROUNDS: u8 = 5;
/// From the second run on that is the last whose result is within so many standard errors of the load it ran with, and
/// lowers the sum of squares by no more than this share: what a further one would correct is less.
const SETTLED_ERRORS: f64 = 0.3;
const SETTLED_SHARE: f64 = 0.05;
/// Rows replayed with each that arrives: the first are behind, because the speed at the start takes some to be known.
const ROWS_PER_ROW: usize = 2;
/// Rows replayed in one piece of work: a step of all replicas, some 0.3 ms on the board, whose other tasks wait meanwhile.
const ROWS_PER_PIECE: usize = 2;
/// What the parts of a search cost, in steps of a replica: one unknown eliminated on average, a generation, and what comes
/// before and after each search.
const ELIMINATION_STEPS: u32 = 12;
const GENERATION_STEPS: u32 = 40;
const SEARCH_STEPS: u32 = 40;

/// Least speed of both motors in a collection, counts a row: some 0.1 rad/s on the paper's robot. Slower, Coulomb friction
/// is about to change its sign.
const LEAST_SPEED_COUNTS: f32 = 1.0;
/// Rows from which on reversals are allowed in a collection: so long a window has motion on both sides.
const REVERSALS_FROM_ROWS: u16 = 700;

/// Work done in one piece.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Piece {
    /// What came of it.
    pub news: Option<LoadNews>,
    /// How much it was, in steps of one replica.
    pub replica_steps: u32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    Off,
    Waiting,
    /// Rows arrive, and the bundle runs over them once its start is known.
    Collecting {
        next: usize,
        counts: [i32; 2],
    },
    /// The bundle runs over the rows.
    Replaying {
        round: u8,
        next: usize,
        counts: [i32; 2],
    },
    /// The nuisances are eliminated, one after the other.
    Eliminating {
        round: u8,
        pivot: usize,
    },
    /// The genetic algorithm runs.
    Searching {
        round: u8,
    },
    /// The nuisances are eliminated from those before them: the arm is empty, and they are all there is to find.
    Learning {
        round: u8,
        pivot: usize,
    },
    /// The result is in use; every row is tested.
    Watching,
}

/// The identification.
#[derive(Clone, Debug)]
pub struct Identifier {
    setup: Option<LoadSetup>,
    stage: Stage,
    waiting: Option<Waiting>,
    /// Whether the rows to come are of an empty arm, and what such rows have shown.
    learning: bool,
    learned: Option<Learned>,
    /// The load that the bundle runs with.
    about: Load<f32>,
    nuisances: [f32; NUISANCES],
    window: Window,
    bundle: Bundle,
    quadratic: Quadratic,
    search: Option<Search>,
    watch: Watch,
    /// Positions of the last rows, the newest last.
    recent: [[i32; 2]; 2 * START_ROWS + 1],
    recent_rows: usize,
    next_index: u32,
    searches: u32,
}

impl Default for Identifier {
    fn default() -> Self {
        Self::new()
    }
}

impl Identifier {
    /// One that has nothing to do.
    pub const fn new() -> Self {
        Self {
            setup: None,
            stage: Stage::Off,
            waiting: None,
            learning: false,
            learned: None,
            about: Load { mass_kg: 0.0, centre_m: [0.0; 2], inertia_kg_m2: 0.0 },
            nuisances: [0.0; NUISANCES],
            window: Window::new(),
            bundle: Bundle::new(),
            quadratic: Quadratic::new(),
            search: None,
            watch: Watch::new(1.0),
            recent: [[0; 2]; 2 * START_ROWS + 1],
            recent_rows: 0,
            next_index: 0,
            searches: 0,
        }
    }

    /// Begins with the rows of a new movement.
    ///
    /// With [`LoadSettings::differential`] and no load assumed the arm is empty, and its errors are learned first; what was
    /// learned holds until the model or the settings change.
    ///
    /// [`LoadSettings::differential`]: super::LoadSettings::differential
    pub fn begin(&mut self, setup: &LoadSetup) {
        let same = |before: &LoadSetup| before.f == setup.f && before.settings == setup.settings;
        self.learning = setup.settings.differential && setup.assumed.mass_kg == 0.0;
        if self.learning || !self.setup.as_ref().is_some_and(same) {
            self.learned = None;
        }
        self.setup = Some(*setup);
        self.about = setup.assumed;
        self.recent_rows = 0;
        self.next_index = 0;
        self.wait();
    }

    /// Ends; rows still to come are ignored.
    pub fn end(&mut self) {
        self.stage = Stage::Off;
        self.search = None;
    }

    fn wait(&mut self) {
        self.stage = Stage::Waiting;
        self.waiting = None;
        self.window.clear();
    }

    /// Whether there is work to do beside the rows.
    pub fn has_work(&self) -> bool {
        !matches!(self.stage, Stage::Off | Stage::Waiting | Stage::Collecting { .. } | Stage::Watching)
    }

    /// Takes in the next row. Bounded time: at most a step of the bundle and a test.
    pub fn push(&mut self, row: &LoadRow) -> Piece {
        let Some(setup) = self.setup else { return Piece::default() };
        if self.stage == Stage::Off {
            return Piece::default();
        }
        let lost = row.index != self.next_index;
        self.next_index = row.index.wrapping_add(1);
        if lost {
            self.recent_rows = 0;
        }
        self.recent.rotate_left(1);
        if let Some(newest) = self.recent.last_mut() {
            *newest = row.counts;
        }
        self.recent_rows = (self.recent_rows + 1).min(self.recent.len());
        match self.stage {
            Stage::Waiting => self.look_for_motion(row, lost),
            Stage::Collecting { next, counts } => self.collect(&setup, row, lost, next, counts),
            Stage::Watching => self.watch(&setup, row, lost),
            _ => Piece::default(),
        }
    }

    /// Counts a row over the recent rows; `None` until there are enough of them.
    fn speed_counts(&self) -> Option<[f32; 2]> {
        let ([first, ..], [.., last]) = (&self.recent, &self.recent);
        (self.recent_rows == self.recent.len()).then(|| {
            let travel = |joint: usize| last[joint].wrapping_sub(first[joint]) as f32 / (2 * START_ROWS) as f32;
            [travel(0), travel(1)]
        })
    }

    /// The same at the newest row: the mean is that of the middle one, and between them the speed goes on changing as over
    /// the recent rows. By the mean alone a light arm, which accelerates by a count a row and more meanwhile, would seem to
    /// carry another load.
    fn newest_speed_counts(&self) -> Option<[f32; 2]> {
        let ([first, ..], [.., last]) = (&self.recent, &self.recent);
        let middle = &self.recent[START_ROWS];
        self.speed_counts().map(|mean| {
            let bend = |joint: usize| {
                let later = last[joint].wrapping_sub(middle[joint]);
                later.wrapping_sub(middle[joint].wrapping_sub(first[joint])) as f32
            };
            [0, 1].map(|joint: usize| mean[joint] + bend(joint) / START_ROWS as f32)
        })
    }

    fn slow_joint(&self) -> Option<u8> {
        match self.speed_counts() {
            None => Some(0),
            Some([second, third]) if second.abs().min(third.abs()) < LEAST_SPEED_COUNTS => {
                Some(if second.abs() < LEAST_SPEED_COUNTS { 0 } else { 1 })
            }
            Some(_) => None,
        }
    }

    fn still_waiting(&mut self, why: Waiting) -> Piece {
        let told = self.waiting.replace(why) == Some(why);
        Piece { news: (!told).then_some(LoadNews::Waiting(why)), replica_steps: 0 }
    }

    fn look_for_motion(&mut self, row: &LoadRow, lost: bool) -> Piece {
        if lost && row.index != 0 {
            return self.still_waiting(Waiting::RowsLost);
        }
        if let Some(joint) = self.slow_joint() {
            return self.still_waiting(Waiting::Slow { joint });
        }
        self.stage = Stage::Collecting { next: 0, counts: [0; 2] };
        self.waiting = None;
        self.window.clear();
        self.window.push(row);
        Piece { news: Some(LoadNews::Collecting), replica_steps: 0 }
    }

    fn collect(
        &mut self,
        setup: &LoadSetup,
        row: &LoadRow,
        lost: bool,
        mut next: usize,
        mut counts: [i32; 2],
    ) -> Piece {
        if lost {
            self.wait();
            return self.still_waiting(Waiting::RowsLost);
        }
        if setup.settings.collect_rows < REVERSALS_FROM_ROWS
            && let Some(joint) = self.slow_joint()
        {
            self.wait();
            return self.still_waiting(Waiting::Slow { joint });
        }
        self.window.push(row);
        let mut replica_steps = 0;
        if self.window.len() == 2 * START_ROWS + 1 {
            self.nuisances = self.learned.as_ref().map_or([0.0; NUISANCES], Learned::nuisances);
            (next, counts) = self.start_bundle(setup);
        } else if next != 0 {
            (next, counts, replica_steps) = self.replay_rows(setup, next, counts, ROWS_PER_ROW);
        }
        if self.window.len() < usize::from(setup.settings.collect_rows) {
            self.stage = Stage::Collecting { next, counts };
            return Piece { news: None, replica_steps };
        }
        self.stage = Stage::Replaying { round: 0, next, counts };
        Piece { news: Some(LoadNews::Searching), replica_steps }
    }

    /// Gets the bundle ready for the rows collected: the next of them, and the counts before it.
    fn start_bundle(&mut self, setup: &LoadSetup) -> (usize, [i32; 2]) {
        let mut counts = self.window.first_counts();
        let mut middle = counts;
        for index in 0..=2 * START_ROWS {
            counts = self.window.row(index, counts).counts;
            if index + 1 == START_ROWS {
                middle = counts;
            }
        }
        let first = self.window.first_counts();
        let speed =
            [0, 1].map(|joint: usize| counts[joint].wrapping_sub(first[joint]) as f32 / (2 * START_ROWS) as f32);
        let start = self.window.row(START_ROWS, middle).counts;
        self.bundle.start(setup, linear_load(&self.about), &self.nuisances, start, speed);
        self.quadratic.clear();
        (START_ROWS, middle)
    }

    /// Runs the bundle over so many rows more, as far as there are any.
    #[inline(never)]
    fn replay_rows(
        &mut self,
        setup: &LoadSetup,
        next: usize,
        mut counts: [i32; 2],
        rows: usize,
    ) -> (usize, [i32; 2], u32) {
        let end = (next + rows).min(self.window.len());
        let mut replica_steps = 0;
        for index in next..end {
            let row = self.window.row(index, counts);
            counts = row.counts;
            let (shown, steps) = self.bundle.advance(setup, &row);
            self.quadratic.add(&shown);
            replica_steps += steps;
        }
        (end, counts, replica_steps)
    }

    /// Starts the bundle over the rows collected once more.
    fn replay(&mut self, setup: &LoadSetup, round: u8) {
        let (next, counts) = self.start_bundle(setup);
        self.stage = Stage::Replaying { round, next, counts };
    }

    /// Does a piece of the work there is, if any. Bounded time.
    pub fn advance(&mut self) -> Piece {
        let Some(setup) = self.setup else { return Piece::default() };
        match self.stage {
            Stage::Replaying { round, next, counts } => self.replay_on(&setup, round, next, counts),
            Stage::Eliminating { round, pivot } => self.eliminate_on(&setup, round, pivot),
            Stage::Searching { round } => self.search_on(&setup, round),
            Stage::Learning { round, pivot } => self.learn_on(&setup, round, pivot),
            Stage::Off | Stage::Waiting | Stage::Collecting { .. } | Stage::Watching => Piece::default(),
        }
    }

    fn replay_on(&mut self, setup: &LoadSetup, round: u8, next: usize, counts: [i32; 2]) -> Piece {
        let (next, counts, replica_steps) = self.replay_rows(setup, next, counts, ROWS_PER_PIECE);
        if next < self.window.len() {
            self.stage = Stage::Replaying { round, next, counts };
            return Piece { news: None, replica_steps };
        }
        self.quadratic.expect(&self.nuisances, self.learned.as_ref());
        self.stage = if self.learning {
            Stage::Learning { round, pivot: NUISANCES }
        } else {
            Stage::Eliminating { round, pivot: 0 }
        };
        Piece { news: None, replica_steps }
    }

    /// What rows of an empty arm show of the model's errors.
    #[inline(never)]
    fn learn_on(&mut self, setup: &LoadSetup, round: u8, pivot: usize) -> Piece {
        if round > 0 && pivot == MODEL_UNKNOWNS {
            self.learned = Some(Learned::new(&self.quadratic));
        }
        if let Some(pivot) = pivot.checked_sub(1) {
            self.quadratic.eliminate_backward(pivot);
            self.stage = Stage::Learning { round, pivot };
            return Piece { news: None, replica_steps: ELIMINATION_STEPS };
        }
        self.nuisances = self.quadratic.settled_nuisances(&self.nuisances);
        let settled = round > 0 && self.quadratic.gained_share() <= SETTLED_SHARE;
        if round + 1 < ROUNDS && !settled {
            self.learned = None;
            self.replay(setup, round + 1);
            return Piece { news: None, replica_steps: SEARCH_STEPS };
        }
        let noise_ratio = self.quadratic.noise_ratio();
        if !(noise_ratio <= LARGEST_NOISE_RATIO && self.nuisances.iter().all(|nuisance| nuisance.is_finite())) {
            self.learned = None;
            self.wait();
            let news = LoadNews::Rejected(Rejected::Inconsistent, LoadEstimate { noise_ratio, ..LoadEstimate::NONE });
            return Piece { news: Some(news), replica_steps: SEARCH_STEPS };
        }
        if let Some(learned) = &mut self.learned {
            learned.is_at(&self.nuisances);
        }
        // The change test asks for variances: those that are left, with no load.
        self.watch = Watch::new(noise_ratio);
        self.quadratic.clear();
        self.quadratic.expect(&self.nuisances, self.learned.as_ref());
        self.stage = Stage::Eliminating { round, pivot: 0 };
        Piece { news: Some(LoadNews::Learned { noise_ratio }), replica_steps: SEARCH_STEPS }
    }

    fn eliminate_on(&mut self, setup: &LoadSetup, round: u8, pivot: usize) -> Piece {
        if pivot < NUISANCES {
            self.quadratic.eliminate(pivot);
            self.stage = Stage::Eliminating { round, pivot: pivot + 1 };
            return Piece { news: None, replica_steps: ELIMINATION_STEPS };
        }
        if self.learning {
            self.learning = false;
            self.quadratic.hold(&self.about);
            self.stage = Stage::Watching;
            return Piece { news: None, replica_steps: SEARCH_STEPS };
        }
        self.searches = self.searches.wrapping_add(1);
        self.search = Search::new(&self.quadratic, &setup.settings, &self.about, self.searches);
        self.stage = Stage::Searching { round };
        Piece { news: None, replica_steps: SEARCH_STEPS }
    }

    fn search_on(&mut self, setup: &LoadSetup, round: u8) -> Piece {
        let Some(search) = &mut self.search else {
            self.wait();
            return Piece { news: Some(LoadNews::Rejected(Rejected::NotFinite, LoadEstimate::NONE)), replica_steps: 1 };
        };
        let done = search.step();
        if !done {
            return Piece { news: None, replica_steps: GENERATION_STEPS };
        }
        let replica_steps = GENERATION_STEPS + SEARCH_STEPS;
        let settled = round > 0
            && search.moved_errors() <= SETTLED_ERRORS
            && search.gained_share(&self.quadratic) <= SETTLED_SHARE;
        if round + 1 < ROUNDS && !settled {
            self.nuisances = search.nuisances(&self.quadratic, &self.nuisances);
            self.about = search.best();
            self.search = None;
            self.replay(setup, round + 1);
            return Piece { news: None, replica_steps };
        }
        let nuisances = search.nuisances(&self.quadratic, &self.nuisances);
        let (estimate, gate) = search.finish(&mut self.quadratic, &setup.settings);
        self.search = None;
        self.about = estimate.load();
        let news = match gate {
            Ok(()) => {
                self.nuisances = nuisances;
                self.watch = Watch::new(estimate.noise_ratio);
                self.stage = Stage::Watching;
                LoadNews::Found(estimate)
            }
            Err(rejected) => {
                self.about = setup.assumed;
                self.wait();
                LoadNews::Rejected(rejected, estimate)
            }
        };
        Piece { news: Some(news), replica_steps }
    }

    fn watch(&mut self, setup: &LoadSetup, row: &LoadRow, lost: bool) -> Piece {
        if lost {
            self.watch.restart();
        }
        if self.watch.is_new() {
            let Some(speed) = self.newest_speed_counts() else { return Piece::default() };
            self.nuisances[MODEL_UNKNOWNS..].fill(0.0);
            self.bundle.start(setup, linear_load(&self.about), &self.nuisances, row.counts, speed);
            self.watch.restart();
        }
        let (shown, mut replica_steps) = self.bundle.advance(setup, row);
        let direction = gradient(&self.about).map(|row| row[0] as f32);
        self.watch.add(&shown, &direction);
        if !self.watch.is_due() {
            return Piece { news: None, replica_steps };
        }
        replica_steps += ELIMINATION_STEPS;
        let Some(by_kg) = self.watch.change_kg(&self.quadratic, &gradient(&self.about), setup.settings.maximum_kg)
        else {
            return Piece { news: None, replica_steps };
        };
        let assumed = setup.settings.held(self.about.mass_kg + by_kg);
        // So early a change is at least what it seems; the replicas run with the middle of what it may be.
        let farthest_kg = if by_kg > 0.0 { setup.settings.maximum_kg } else { 0.0 };
        self.about = setup.settings.held(0.5 * (assumed.mass_kg + farthest_kg));
        self.wait();
        Piece { news: Some(LoadNews::Changed { by_kg, assumed_kg: assumed.mass_kg }), replica_steps }
    }
}
