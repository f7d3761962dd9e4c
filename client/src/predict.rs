//! For predictors in a process of their own: `PenSteps` and `Previews`.

use foretrace_shm::{
    Claimant, Holder, PREVIEW_STEPS, PenPreview, PenStep, Place, PublishError, Rejection, ServiceError,
    Validate, monotonic_now_ns, preview_flags,
};

use crate::Foretrace;
use crate::seat::Seat;
use crate::watch::MessageWatch;

/// The steps of the pen's grid as they close, while predictor `external` is chosen.
pub type PenSteps = MessageWatch<PenStep>;

/// Why a preview was not sent.
#[derive(Clone, Copy, PartialEq, thiserror::Error)]
pub enum PreviewSendError {
    /// No positions, or more than there is room for.
    #[error("a preview has {got} positions, legal are 1 to 64: as many as `wanted` of the step asks for")]
    Positions {
        /// As many as there were.
        got: usize,
    },
    /// Neither none nor one per position.
    #[error("a preview has {got} radii for {positions} positions: give none, or one per position")]
    Radii {
        /// As many as there were.
        got: usize,
        /// Positions that came beside them.
        positions: usize,
    },
    /// A number that cannot be used.
    #[error("{what} {number} of the preview is {value} m, legal are finite numbers{}", if *what == "radius" { " from 0 on" } else { "" })]
    NotFinite {
        /// `x`, `y` or `radius`.
        what: &'static str,
        /// Its number, from 0.
        number: usize,
        /// What the number stands for.
        value: f64,
    },
    /// The daemon would refuse it.
    #[error("the preview is invalid: {0}")]
    Invalid(#[from] Rejection),
    /// It could not be delivered.
    #[error("the preview was not sent: {0}")]
    NotSent(#[from] PublishError),
    /// Somebody asked for the predictor's place and has it.
    #[error("the predictor's place was handed to a program that asked for it: end this one")]
    HandedOver,
}

/// Sends previews. One per instance at a time.
#[derive(Debug)]
pub struct Previews(Seat<PenPreview>);

impl Foretrace {
    /// The steps of the pen's grid, to be used in this thread. Nothing comes unless `predictor.kind` is
    /// `external`, set or requested.
    ///
    /// # Errors
    ///
    /// As the middleware's, see [`ServiceError`].
    pub fn pen_steps(&self) -> Result<PenSteps, ServiceError> {
        self.watch(&self.services.pen_step)
    }

    /// The predictor's place, to be used in this thread, held in the name of this program.
    ///
    /// # Errors
    ///
    /// `Place` when another predictor has it: it names that one.
    pub fn previews(&self) -> Result<Previews, ServiceError> {
        let claim = self.instance().claim(Place::Predictor, &Claimant::this_program())?;
        Seat::take(claim, &self.services.preview, self.leaving.clone()).map(Previews)
    }
}

impl Previews {
    /// Sends where the pen will be after step `base_index`: entry i one step later than entry i - 1, in the
    /// frame of [`PenStep`] \[m\]. `radii`: none, or per position the radius in which the pen is expected in
    /// nine of ten cases \[m\]. Returns whether the daemon was connected.
    ///
    /// # Errors
    ///
    /// See [`PreviewSendError`]; nothing is sent then.
    pub fn send(
        &mut self,
        base_index: u64,
        positions: &[[f64; 2]],
        radii: &[f64],
    ) -> Result<bool, PreviewSendError> {
        let got = positions.len();
        if !(1..=PREVIEW_STEPS).contains(&got) {
            return Err(PreviewSendError::Positions { got });
        }
        if !(radii.is_empty() || radii.len() == got) {
            return Err(PreviewSendError::Radii { got: radii.len(), positions: got });
        }
        for (number, [x, y]) in positions.iter().enumerate() {
            for (what, value) in [("x", *x), ("y", *y)] {
                if !value.is_finite() {
                    return Err(PreviewSendError::NotFinite { what, number, value });
                }
            }
        }
        if let Some((number, value)) = radii.iter().enumerate().find(|(_, r)| !(r.is_finite() && **r >= 0.0))
        {
            return Err(PreviewSendError::NotFinite { what: "radius", number, value: *value });
        }
        let mut preview = PenPreview {
            base_index,
            count: got as u32,
            flags: if radii.is_empty() { 0 } else { preview_flags::RADII },
            ..PenPreview::default()
        };
        for ((x, y), position) in preview.x_m.iter_mut().zip(&mut preview.y_m).zip(positions) {
            [*x, *y] = *position;
        }
        for (slot, radius) in preview.radius_m.iter_mut().zip(radii) {
            *slot = *radius;
        }
        self.send_preview(preview)
    }

    /// Sends a preview as it stands; its header is filled in. Its numbers are the daemon's to judge.
    ///
    /// # Errors
    ///
    /// As [`Previews::send`].
    pub fn send_preview(&mut self, preview: PenPreview) -> Result<bool, PreviewSendError> {
        preview.validate()?;
        let now_ns = monotonic_now_ns();
        self.0.give_way_if_asked(now_ns);
        let publisher = self.0.publisher().ok_or(PreviewSendError::HandedOver)?;
        Ok(publisher.publish(now_ns, preview)? > 0)
    }

    /// Gives way to whoever asks, and returns who has the place since then.
    pub fn handed_to(&mut self) -> Option<&Holder> {
        self.0.give_way_if_asked(monotonic_now_ns());
        self.0.handed_to()
    }

    /// Previews sent so far.
    pub fn sent(&self) -> u64 {
        self.0.sent()
    }
}
