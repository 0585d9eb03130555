//! What a simulated arm carries, and the identification of it beside the simulated board.

use std::collections::VecDeque;

use shared::arm::{Load, PARAMETERS};
use shared::board::{Board, LoadOrder};
use shared::load::{COST_NS_PER_REPLICA_STEP, Identifier, LoadRow};
use shared::protocol::{ControlLaw, Mode, PackedSample};

/// The share of its time that a board has left for the identification: a control tick under computed torque takes a
/// twentieth, the links another.
const SHARE_OF_TIME: f64 = 0.85;

/// What the task does for a row beside the replicas, ns.
const COST_NS_PER_ROW: i64 = 5_000;

/// How long it rests after each piece of a search, so that the links get their turn, ns.
const PAUSE_NS: i64 = 150_000;

/// Something is taken up, or set down, or dropped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadChange {
    /// When, in s after the start of the recording.
    pub at_s: f64,
    /// What the arm carries from then on; a mass of zero for nothing.
    pub load: Load<f64>,
}

/// The load and its identification, in virtual time.
pub(super) struct SimulatedLoad {
    upper_arm_m: f64,
    from_start: Load<f64>,
    changes: Vec<LoadChange>,
    carried: Load<f64>,
    recorded_ns: u64,
    identifier: Box<Identifier>,
    rows: VecDeque<LoadRow>,
    /// Time the task has had and not used; below 0 while a piece of work is not done yet.
    time_ns: i64,
}

impl SimulatedLoad {
    pub fn new(upper_arm_m: f64) -> Self {
        let nothing = Load { mass_kg: 0.0, centre_m: [0.0; 2], inertia_kg_m2: 0.0 };
        Self {
            upper_arm_m,
            from_start: nothing,
            changes: Vec::new(),
            carried: nothing,
            recorded_ns: 0,
            identifier: Box::new(Identifier::new()),
            rows: VecDeque::new(),
            time_ns: 0,
        }
    }

    pub fn carry(&mut self, from_start: Load<f64>, changes: &[LoadChange]) {
        self.from_start = from_start;
        self.carried = from_start;
        self.changes = changes.to_vec();
    }

    /// What is carried adds to f1..f9.
    pub fn added_f(&self) -> [f64; PARAMETERS] {
        self.carried.delta_f(self.upper_arm_m)
    }

    /// A tick passes; true where something else is carried after it.
    pub fn pass(&mut self, mode: Mode, period_ns: u64) -> bool {
        if self.changes.is_empty() {
            return false;
        }
        match mode {
            Mode::Running(ControlLaw::ComputedTorque) => self.recorded_ns += period_ns,
            Mode::Approaching(_) => self.recorded_ns = 0,
            _ => return false,
        }
        let recorded_s = 1e-9 * self.recorded_ns as f64;
        let due = self.changes.iter().rfind(|change| change.at_s < recorded_s);
        let carried = due.map_or(self.from_start, |change| change.load);
        std::mem::replace(&mut self.carried, carried) != carried
    }

    /// The board was switched off and on.
    pub fn restart(&mut self) {
        *self.identifier = Identifier::new();
        self.rows.clear();
        self.time_ns = 0;
    }

    /// Hands orders and the row on, and lets the identification work for the time that a board has left of a period.
    pub fn identify(&mut self, board: &mut Board<Vec<PackedSample>>, row: Option<LoadRow>, period_ns: u64) {
        match board.take_load_order() {
            Some(LoadOrder::Begin(setup)) => self.identifier.begin(&setup),
            Some(LoadOrder::End) => self.identifier.end(),
            None => {}
        }
        self.rows.extend(row);
        self.time_ns += (SHARE_OF_TIME * period_ns as f64) as i64;
        while self.time_ns > 0 {
            let (piece, beside_ns) = if let Some(row) = self.rows.pop_front() {
                (self.identifier.push(&row), COST_NS_PER_ROW)
            } else if self.identifier.has_work() {
                (self.identifier.advance(), PAUSE_NS)
            } else {
                self.time_ns = 0;
                return;
            };
            self.time_ns -= beside_ns + (u64::from(piece.replica_steps) * COST_NS_PER_REPLICA_STEP) as i64;
            if let Some(news) = &piece.news {
                board.hear_of_load(news);
            }
        }
    }
}
