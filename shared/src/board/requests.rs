//! What the board does with each request.

use super::motion::Start;
use super::session::{Order, Outcome};
use super::{Board, Findings, LONGEST_SETTLE_NS};
use crate::load::{LoadNews, LoadSettings};
use crate::protocol::{
    ControlLaw, EndedBy, Info, Joint, Link, Mode, ModelSlot, PROTOCOL_VERSION, PackedSample, Refusal, Reply, Request,
    Status, TrajectoryPart,
};
use crate::trajectory::Approach;

/// Largest declared position in counts, so that there is room on both sides in 32 bits.
const LARGEST_POSITION_COUNTS: f64 = 1.0e9;

impl<R: AsRef<[PackedSample]> + AsMut<[PackedSample]>> Board<R> {
    /// Carries out one request that came over `link`. Bounded time, no panic. The reply goes back over the same link
    /// with the request's sequence number.
    ///
    /// A request with the number of the link's last one is not carried out again, but answered again; an older one, or
    /// one before [`Request::Hello`], is refused. Every request that gets here keeps the link alive.
    pub fn handle(&mut self, link: Link, sequence: u32, request: &Request) -> Reply {
        let mut reply = Reply::Done;
        self.answer(link, sequence, request, &Findings::of(request), &mut reply);
        reply
    }

    /// [`Self::handle`] for the control interrupt: of a request that was examined before, into the place from which the
    /// reply is sent. What is left takes no longer than a control tick has room for, where the request is possible while
    /// the amplifiers are on. `findings` must be those of `request`.
    pub fn answer(&mut self, link: Link, sequence: u32, request: &Request, findings: &Findings, reply: &mut Reply) {
        self.motion.heard(link);
        if let &Request::Hello { protocol_version: host } = request {
            if host != PROTOCOL_VERSION {
                self.session(link).close();
                let firmware_version = self.identity.firmware_version.clone();
                *reply = Reply::WrongVersion { board: PROTOCOL_VERSION, host, firmware_version };
                return;
            }
            // Done afresh every time: it changes nothing but the link's own number.
            self.session(link).answered(sequence, Ok(Outcome::Done));
            return self.report(request, reply);
        }
        match self.session(link).order(sequence) {
            Order::New => {
                let result = self.carry_out(link, request, findings);
                self.session(link).answered(sequence, result);
            }
            Order::Last => {}
            Order::Refused(refusal) => {
                *reply = Reply::Refused(refusal);
                return;
            }
        }
        let [usb, serial] = &self.sessions;
        let session = if link == Link::Usb { usb } else { serial };
        match session.result() {
            Ok(Outcome::Done) => self.report(request, reply),
            &Ok(Outcome::Started { movement, approach_ns, rows }) => {
                *reply = Reply::Started { movement, approach_ns, rows };
            }
            Err(refusal) => *reply = Reply::Refused(*refusal),
        }
    }

    fn session(&mut self, link: Link) -> &mut super::Session {
        let [usb, serial] = &mut self.sessions;
        match link {
            Link::Usb => usb,
            Link::Serial => serial,
        }
    }

    fn info(&self) -> Info {
        Info {
            protocol_version: PROTOCOL_VERSION,
            identity: self.identity.clone(),
            recording_capacity: self.recording.capacity(),
            knot_capacity: crate::trajectory::MAX_POINTS as u16,
            robot_identity: self.parameters.applied.as_ref().map(|applied| applied.robot_identity),
            last_fault: self.motion.last_fault(),
            timing: self.timing,
            links: self.links,
        }
    }

    /// Answers a request that was carried out: with the state it asks about, as it is now. Each reply is made where it
    /// is to be; a copy of one costs as much as a law of control.
    fn report(&self, request: &Request, reply: &mut Reply) {
        match request {
            Request::IdentifyLoad(_) | Request::ForgetLoad | Request::UseLoad(_) | Request::ReadLoad => {
                *reply = Reply::Load(self.load.report());
            }
            Request::Hello { .. } => *reply = Reply::Info(self.info()),
            Request::Status => *reply = Reply::Status(self.status()),
            Request::LoadTrajectory(_) | Request::ReadTrajectory => self.trajectories.report(reply),
            Request::RecordingInfo => *reply = Reply::Recording(self.recording.info()),
            &Request::ReadRecording { from, count } => self.recording.report(from, count, reply),
            Request::StageModel { .. } => self.report_model(ModelSlot::Staged, reply),
            Request::CommitModel { .. } => self.report_model(ModelSlot::Active, reply),
            &Request::ReadModel(slot) => self.report_model(slot, reply),
            Request::KeepAlive
            | Request::Configure(_)
            | Request::ApplyConfiguration { .. }
            | Request::SetPosition { .. }
            | Request::Arm
            | Request::Disarm
            | Request::Run { .. }
            | Request::Stop
            | Request::ClearFault
            | Request::ForgetParameters => *reply = Reply::Done,
        }
    }

    fn carry_out(&mut self, link: Link, request: &Request, findings: &Findings) -> Result<Outcome, Refusal> {
        match request {
            Request::Hello { .. }
            | Request::KeepAlive
            | Request::Status
            | Request::ReadTrajectory
            | Request::RecordingInfo
            | Request::ReadRecording { .. }
            | Request::ReadModel(_)
            | Request::ReadLoad => {}
            Request::IdentifyLoad(settings) => self.identify_load(settings)?,
            Request::UseLoad(estimate) => {
                if !self.load.accepts(estimate) {
                    return Err(Refusal::BadLoad);
                }
                self.hear_of_load(&LoadNews::Found(*estimate));
            }
            Request::ForgetLoad => {
                self.not_moving()?;
                self.load.forget();
            }
            Request::Configure(part) => {
                self.only_idle()?;
                self.parameters.stage_part(part);
            }
            &Request::ApplyConfiguration { crc } => {
                self.only_idle()?;
                let change = self.parameters.apply_parts(crc)?;
                self.configuration_changed(change);
                self.storing.keep();
            }
            &Request::SetPosition { position_rad } => self.set_position(position_rad)?,
            Request::Arm => self.arm(link)?,
            Request::Disarm => {
                self.recording.end(EndedBy::Stopped);
                // A fault is not forgotten by disarming.
                if self.mode().is_powered() {
                    self.motion.switch_off();
                }
            }
            Request::LoadTrajectory(part) => self.load_trajectory(part, findings)?,
            &Request::Run { law, stream, settle_ns } => return self.run(link, law, stream, settle_ns),
            Request::Stop => {
                if let Some(applied) = &self.parameters.applied {
                    self.motion.stop(self.encoders.position_counts(), &applied.constants);
                    self.recording.end(EndedBy::Stopped);
                }
            }
            Request::StageModel { model, crc } => self.parameters.stage_model(model, *crc, findings)?,
            &Request::CommitModel { crc } => {
                self.parameters.commit_model(crc)?;
                if self.mode().law() == Some(ControlLaw::ComputedTorque)
                    && let Some(applied) = &self.parameters.applied
                    && let Some(held) = self.parameters.model(ModelSlot::Active)
                {
                    // Where it stands it knows itself.
                    let mut next =
                        applied.constants.computed_torque(&held.torque_model, &held.compensation(), [0.0; 2]);
                    // The load stays in the gripper, and is identified from now on with the new model.
                    if let Some(added) = self.load.begin(&applied.constants, held) {
                        next.add_to_f(&added);
                    }
                    self.motion.change_model(&next);
                }
                self.storing.keep();
            }
            Request::ClearFault => {
                if self.emergency_stop {
                    return Err(Refusal::EmergencyStop);
                }
                if matches!(self.mode(), Mode::Fault(_)) {
                    self.motion.switch_off();
                }
            }
            Request::ForgetParameters => {
                self.only_idle()?;
                self.storing.forget();
            }
        }
        Ok(Outcome::Done)
    }

    fn wrong_mode(&self) -> Refusal {
        Refusal::WrongMode { mode: self.mode() }
    }

    fn only_idle(&self) -> Result<(), Refusal> {
        if self.mode() == Mode::Idle { Ok(()) } else { Err(self.wrong_mode()) }
    }

    fn status(&self) -> Status {
        let applied = self.parameters.applied.as_ref();
        let measured = |index: usize| {
            let joint = applied.and_then(|applied| applied.constants.joints.get(index));
            joint.zip(self.current_code.get(index)).map_or(0.0, |(joint, &code)| joint.measured_a(code))
        };
        Status {
            mode: self.mode(),
            tick: self.tick,
            position_counts: self.encoders.position_counts(),
            pose_known: self.encoders.pose_known(),
            error_counts: self.motion.error_counts(),
            current_a: [measured(0), measured(1)],
            emergency_stop: self.emergency_stop,
            limits_active: self.motion.limits(),
            configuration_crc: applied.map(|applied| applied.crc),
            active_model_crc: self.parameters.model(ModelSlot::Active).map(|held| held.crc),
            staged_model_crc: self.parameters.model(ModelSlot::Staged).map(|held| held.crc),
            stored: self.storing.stored(),
            trajectory: self.trajectories.phase(),
            recording: self.recording.info(),
        }
    }

    fn report_model(&self, slot: ModelSlot, reply: &mut Reply) {
        *reply = match self.parameters.model(slot) {
            Some(held) => Reply::Model { slot, model: Some(held.model), crc: held.crc },
            None => Reply::Model { slot, model: None, crc: 0 },
        };
    }

    fn not_moving(&self) -> Result<(), Refusal> {
        if self.mode().is_moving() { Err(self.wrong_mode()) } else { Ok(()) }
    }

    fn identify_load(&mut self, settings: &LoadSettings) -> Result<(), Refusal> {
        self.not_moving()?;
        let constants = &self.parameters.applied()?.constants;
        let (loop_ns, record_ns) = (constants.loop_period_ns, constants.record_period_ns);
        if loop_ns != record_ns {
            return Err(Refusal::LoadNeedsEveryTick { loop_ns, record_ns });
        }
        settings.check().map_err(Refusal::Load)?;
        self.load.configure(settings);
        Ok(())
    }

    fn set_position(&mut self, position_rad: [f64; 2]) -> Result<(), Refusal> {
        self.only_idle()?;
        let joints = &self.parameters.applied()?.configuration.joints;
        let mut position_counts = [0; 2];
        for (((joint, constants), value), counts) in
            Joint::ALL.into_iter().zip(joints).zip(position_rad).zip(&mut position_counts)
        {
            let exact = value * constants.counts_per_rad();
            if exact.is_nan() || exact.abs() > LARGEST_POSITION_COUNTS {
                return Err(Refusal::BadPosition { joint, value });
            }
            // The cast truncates toward zero: the paper's fix().
            *counts = exact as i32;
        }
        self.encoders.declare(position_counts);
        self.parameters.pose_declared();
        Ok(())
    }

    fn arm(&mut self, link: Link) -> Result<(), Refusal> {
        self.only_idle()?;
        self.parameters.applied()?;
        if self.emergency_stop {
            return Err(Refusal::EmergencyStop);
        }
        if self.storing.is_writing() {
            return Err(Refusal::Storing);
        }
        if !self.encoders.pose_known() {
            return Err(Refusal::PoseUnknown);
        }
        self.motion.arm(link, self.encoders.position_counts());
        Ok(())
    }

    fn load_trajectory(&mut self, part: &TrajectoryPart, findings: &Findings) -> Result<(), Refusal> {
        let of_points = matches!(part, TrajectoryPart::BeginPoints { .. } | TrajectoryPart::Points { .. });
        let mode = self.mode();
        // Solving for a spline takes several loop periods, so it is not done while a loop is closed.
        if mode.is_moving() || of_points && mode.is_powered() {
            return Err(self.wrong_mode());
        }
        let capacity = self.recording.capacity();
        let constants = &self.parameters.applied.as_ref().ok_or(Refusal::NotConfigured)?.constants;
        self.trajectories.load(part, findings, constants, capacity)
    }

    fn run(&mut self, link: Link, law: ControlLaw, stream: bool, settle_ns: u64) -> Result<Outcome, Refusal> {
        if !matches!(self.mode(), Mode::Armed | Mode::Holding(_)) {
            return Err(self.wrong_mode());
        }
        if settle_ns > LONGEST_SETTLE_NS {
            return Err(Refusal::SettleTooLong { settle_ns, limit_ns: LONGEST_SETTLE_NS });
        }
        let applied = self.parameters.applied()?;
        let constants = &applied.constants;
        let accepted = self.trajectories.accepted().ok_or(Refusal::NoTrajectory)?;
        let position_counts = self.encoders.position_counts();
        // Each law starts from where it stands still: the position loop from its reference, with the error that
        // carries the arm's weight; computed torque, which has no such error, from where the arm is.
        let (from_counts, model) = match law {
            ControlLaw::Position => (self.motion.holding_counts(position_counts, constants), None),
            ControlLaw::ComputedTorque => {
                (position_counts, Some(self.parameters.model(ModelSlot::Active).ok_or(Refusal::NoModel)?))
            }
        };
        let [first, second] = &constants.joints;
        let [a, b] = from_counts;
        let from_rad = [first.position_rad(a), second.position_rad(b)];
        let approach = Approach::new(
            from_rad,
            accepted.start_rad,
            &constants.motion_limits,
            constants.counts_per_rad(),
            constants.record_period_ns,
        )
        .map_err(Refusal::Limit)?;
        let computed_torque = model.map(|held| {
            let mut controller = constants.computed_torque(&held.torque_model, &held.compensation(), from_rad);
            if let Some(added) = self.load.begin(constants, held) {
                controller.add_to_f(&added);
            }
            controller
        });
        let approach_ns = approach.duration_ns().saturating_add(settle_ns);
        let (configuration_crc, model_crc) = (applied.crc, model.map(|held| held.crc));
        let rows = accepted.rows;
        self.recording.begin(rows, configuration_crc, model_crc);
        self.stream = stream.then_some(link);
        self.motion.start(Start { law, computed_torque, approach, settle_ns, rows, commander: link });
        Ok(Outcome::Started { movement: self.recording.info().movement, approach_ns, rows })
    }
}
