//! The variables of calls. A call's frame is gone when the call is over, also where a thread that was started
//! in it still runs.

use super::super::limits;
use super::super::value::Value;

/// A frame, which may be gone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FrameId {
    at: usize,
    serial: u64,
}

#[derive(Debug)]
pub(super) struct Frame {
    serial: u64,
    /// The function's number.
    pub(super) body: usize,
    pub(super) values: Vec<Option<Value>>,
    /// The frame of the function that it stands in.
    pub(super) around: Option<FrameId>,
    /// The instruction after the call.
    pub(super) back: usize,
    /// How many values stood on the stack.
    pub(super) base: usize,
}

#[derive(Debug, Default)]
pub(super) struct Frames {
    slots: Vec<Option<Frame>>,
    free: Vec<usize>,
    serial: u64,
    /// Variables of all frames.
    variables: usize,
}

impl Frames {
    pub(super) fn open(
        &mut self,
        body: usize,
        values: Vec<Option<Value>>,
        around: Option<FrameId>,
        back: usize,
        base: usize,
    ) -> Result<FrameId, String> {
        let variables = self.variables.saturating_add(values.len());
        if variables > limits::LIVE_VARIABLES {
            return Err(format!("more than {} variables in all calls that are open", limits::LIVE_VARIABLES));
        }
        self.variables = variables;
        self.serial = self.serial.wrapping_add(1);
        let frame = Some(Frame { serial: self.serial, body, values, around, back, base });
        let at = self.free.pop().unwrap_or(self.slots.len());
        match self.slots.get_mut(at) {
            Some(slot) => *slot = frame,
            None => self.slots.push(frame),
        }
        Ok(FrameId { at, serial: self.serial })
    }

    pub(super) fn close(&mut self, id: FrameId) -> Option<Frame> {
        self.get(id)?;
        let frame = self.slots.get_mut(id.at)?.take()?;
        self.free.push(id.at);
        self.variables = self.variables.saturating_sub(frame.values.len());
        Some(frame)
    }

    pub(super) fn get(&self, id: FrameId) -> Option<&Frame> {
        self.slots.get(id.at)?.as_ref().filter(|frame| frame.serial == id.serial)
    }

    pub(super) fn get_mut(&mut self, id: FrameId) -> Option<&mut Frame> {
        self.slots.get_mut(id.at)?.as_mut().filter(|frame| frame.serial == id.serial)
    }

    /// The frame `up` functions around.
    pub(super) fn up(&self, id: FrameId, up: u8) -> Option<FrameId> {
        (0..up).try_fold(id, |id, _| self.get(id)?.around)
    }

    /// The frame of the function `body` that `id` is, or stands in.
    pub(super) fn around(&self, id: FrameId, body: usize) -> Option<FrameId> {
        let mut id = id;
        // Each step goes to a function further out, so it ends.
        loop {
            let frame = self.get(id)?;
            if frame.body == body {
                return Some(id);
            }
            id = frame.around?;
        }
    }

    /// What all the variables hold, in elements.
    pub(super) fn weight(&self) -> usize {
        let values = self.slots.iter().flatten().flat_map(|frame| frame.values.iter().flatten());
        values.map(Value::weight).fold(0, usize::saturating_add)
    }
}
