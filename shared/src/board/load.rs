//! The load in computed torque: what is assumed of it, and how a change enters by degrees.
//!
//! The identification itself is not part of the board ([`crate::load::Identifier`]): it takes longer than a tick has, so
//! whoever runs the board runs it beside, hands it orders and rows, and brings back the news.

use super::constants::Constants;
use super::motion::Motion;
use super::parameters::Held;
use crate::arm::{Load, PARAMETERS};
use crate::load::{LoadEstimate, LoadNews, LoadRow, LoadSettings, LoadSetup};
use crate::protocol::{LoadReport, Sample};

/// How long a change of the load takes to enter computed torque, ns: some periods of its error's motion.
const RAMP_NS: u64 = 30_000_000;

/// What the identification is to do.
#[derive(Clone, Copy, Debug)]
#[expect(clippy::large_enum_variant, reason = "there is one of it, and nothing here allocates")]
pub enum LoadOrder {
    /// Begin with the rows of a new movement.
    Begin(LoadSetup),
    /// End.
    End,
}

/// Settings, what is assumed and what is on its way into the controller.
#[derive(Clone, Debug)]
pub(super) struct LoadControl {
    settings: Option<LoadSettings>,
    assumed: Load<f32>,
    /// What the load still has to add to f, and how much of it a tick.
    step: [f32; PARAMETERS],
    ticks_left: u32,
    /// What the controller has of it now.
    entered: [f32; PARAMETERS],
    order: Option<LoadOrder>,
    event: Option<LoadNews>,
    report: LoadReport,
}

impl LoadControl {
    pub(super) const fn new() -> Self {
        Self {
            settings: None,
            assumed: Load { mass_kg: 0.0, centre_m: [0.0; 2], inertia_kg_m2: 0.0 },
            step: [0.0; PARAMETERS],
            ticks_left: 0,
            entered: [0.0; PARAMETERS],
            order: None,
            event: None,
            report: LoadReport::NONE,
        }
    }

    /// From the next movement on loads are identified.
    pub(super) fn configure(&mut self, settings: &LoadSettings) {
        *self = Self::new();
        self.settings = Some(*settings);
        self.assumed = settings.assumed();
        self.report.settings_active = true;
        self.report.assumed_kg = self.assumed.mass_kg;
    }

    /// No load is assumed any more.
    pub(super) fn forget(&mut self) {
        let was_active = self.settings.is_some();
        *self = Self::new();
        if was_active {
            self.order = Some(LoadOrder::End);
        }
    }

    pub(super) fn report(&self) -> LoadReport {
        self.report
    }

    pub(super) fn take_order(&mut self) -> Option<LoadOrder> {
        self.order.take()
    }

    pub(super) fn has_event(&self) -> bool {
        self.event.is_some()
    }

    /// Copies more than a tick without news should.
    #[inline(never)]
    pub(super) fn take_event(&mut self) -> Option<LoadNews> {
        self.event.take()
    }

    /// A movement under computed torque begins; gives what the load adds to the model's f.
    pub(super) fn begin(&mut self, constants: &Constants, held: &Held) -> Option<[f32; PARAMETERS]> {
        let settings = self.settings.as_ref()?;
        if !settings.by_host {
            self.order = Some(LoadOrder::Begin(constants.load_setup(&held.torque_model, settings, &self.assumed)));
        }
        self.entered = self.assumed.delta_f(settings.upper_arm_m);
        self.ticks_left = 0;
        Some(self.entered)
    }

    /// What the identification sees of a row recorded under computed torque.
    #[inline(always)]
    pub(super) fn row(&self, sample: &Sample) -> Option<LoadRow> {
        self.settings.is_some_and(|settings| !settings.by_host).then(|| LoadRow {
            index: sample.index,
            counts: [0, 1]
                .map(|joint: usize| sample.reference_counts[joint].wrapping_sub(i32::from(sample.error_counts[joint]))),
            command_code: sample.command_code,
        })
    }

    /// Whether a load found elsewhere may be used: the physical gate.
    pub(super) fn accepts(&self, estimate: &LoadEstimate) -> bool {
        let [x, y] = estimate.centre_m;
        self.settings.is_some_and(|settings| {
            (0.0..=settings.maximum_kg).contains(&estimate.mass_kg)
                && x * x + y * y <= settings.reach_m * settings.reach_m
                && (0.0..=10.0).contains(&estimate.inertia_kg_m2)
        })
    }

    /// The identification has something to tell.
    pub(super) fn hear(&mut self, news: &LoadNews, tick: u64, period_ns: u64) {
        let Some(settings) = &self.settings else { return };
        let assumed = match news {
            LoadNews::Waiting(_) | LoadNews::Learned { .. } => None,
            LoadNews::Collecting => {
                self.report.collecting_tick = tick;
                None
            }
            LoadNews::Searching => {
                self.report.searching_tick = tick;
                None
            }
            LoadNews::Rejected(..) => {
                self.report.rejections = self.report.rejections.wrapping_add(1);
                None
            }
            LoadNews::Found(estimate) => {
                self.report.found = Some(*estimate);
                self.report.found_tick = tick;
                self.report.identifications = self.report.identifications.wrapping_add(1);
                Some(estimate.load())
            }
            &LoadNews::Changed { assumed_kg, .. } => {
                self.report.found = None;
                self.report.changes = self.report.changes.wrapping_add(1);
                Some(settings.held(assumed_kg))
            }
        };
        if let Some(load) = assumed {
            self.assumed = load;
            self.report.assumed_kg = load.mass_kg;
            let target = load.delta_f(settings.upper_arm_m);
            self.ticks_left = ((RAMP_NS / period_ns.max(1)) as u32).max(1);
            let share = 1.0 / self.ticks_left as f32;
            for (step, (target, entered)) in self.step.iter_mut().zip(target.iter().zip(&self.entered)) {
                *step = (target - entered) * share;
            }
        }
        self.event = Some(*news);
    }

    /// One tick: lets a change enter by one degree more.
    #[inline(always)]
    pub(super) fn enter(&mut self, motion: &mut Motion) {
        if self.ticks_left != 0 {
            self.enter_a_degree(motion);
        }
    }

    #[inline(never)]
    fn enter_a_degree(&mut self, motion: &mut Motion) {
        self.ticks_left -= 1;
        motion.add_to_f(&self.step);
        for (entered, step) in self.entered.iter_mut().zip(&self.step) {
            *entered += step;
        }
    }
}
