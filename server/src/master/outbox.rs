//! What waits to be written to one peer. Bounded whatever the peer does: of frames and swaps only the newest stay.

use std::collections::VecDeque;

/// Most control messages that wait for one peer: a welcome, a manifest and some room.
pub const MAX_QUEUED: usize = 8;
/// Most messages of all kinds that wait for one peer: of every other kind, one.
pub const MAX_WAITING: usize = MAX_QUEUED + 4;

/// What a message is to the queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Written in order, never dropped.
    Control,
    /// Replaces an unwritten one.
    Swap,
    /// Replaces an unwritten one.
    Frame,
    /// Written where nothing else is.
    Alive,
    /// Written last; drops a frame that waits.
    Bye,
}

/// An encoded message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// What it is to the queue.
    pub kind: Kind,
    /// Length and body.
    pub bytes: Vec<u8>,
}

/// Messages that wait, in this order: control, swap, frame, alive, bye.
///
/// A swap may overtake a frame only into the right place: it always speaks of an older frame than the one that waits,
/// since the peer has said that it drew it.
#[derive(Debug, Default)]
pub struct Outbox {
    control: VecDeque<Message>,
    swap: Option<Message>,
    frame: Option<Message>,
    alive: Option<Message>,
    bye: Option<Message>,
}

/// The peer does not read.
#[derive(Debug, PartialEq, Eq)]
pub struct Full;

impl Outbox {
    /// Queues a message. Gives back the one that it replaced, for its memory.
    ///
    /// # Errors
    /// When [`MAX_QUEUED`] control messages wait already.
    pub fn push(&mut self, message: Message) -> Result<Option<Message>, Full> {
        if self.bye.is_some() {
            return Ok(Some(message)); // nothing follows a goodbye
        }
        match message.kind {
            Kind::Control if self.control.len() == MAX_QUEUED => Err(Full),
            Kind::Control => {
                self.control.push_back(message);
                Ok(None)
            }
            Kind::Swap => Ok(self.swap.replace(message)),
            Kind::Frame => Ok(self.frame.replace(message)),
            Kind::Alive => Ok(self.alive.replace(message)),
            Kind::Bye => {
                self.bye = Some(message);
                Ok(self.frame.take())
            }
        }
    }

    /// How many messages wait; [`MAX_WAITING`] at most.
    pub fn waiting(&self) -> usize {
        let others = [&self.swap, &self.frame, &self.alive, &self.bye];
        self.control.len() + others.into_iter().flatten().count()
    }

    /// What to write next.
    pub fn pop(&mut self) -> Option<Message> {
        let control = self.control.pop_front();
        let replaceable = [&mut self.swap, &mut self.frame, &mut self.alive, &mut self.bye];
        control.or_else(|| replaceable.into_iter().find_map(Option::take))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(kind: Kind, byte: u8) -> Message {
        Message { kind, bytes: vec![byte] }
    }

    #[test]
    fn the_newest_frame_and_swap_win_and_a_goodbye_is_last() {
        let mut outbox = Outbox::default();
        for (kind, byte) in [(Kind::Frame, 1), (Kind::Control, 2), (Kind::Swap, 3), (Kind::Frame, 4), (Kind::Swap, 5)] {
            let replaced = outbox.push(message(kind, byte)).unwrap();
            assert_eq!(replaced.is_some(), byte >= 4);
        }
        let order: Vec<u8> = std::iter::from_fn(|| outbox.pop()).map(|m| m.bytes[0]).collect();
        assert_eq!(order, [2, 5, 4]);
        outbox.push(message(Kind::Frame, 1)).unwrap();
        outbox.push(message(Kind::Swap, 2)).unwrap();
        outbox.push(message(Kind::Bye, 3)).unwrap();
        outbox.push(message(Kind::Frame, 4)).unwrap();
        let order: Vec<u8> = std::iter::from_fn(|| outbox.pop()).map(|m| m.bytes[0]).collect();
        assert_eq!(order, [2, 3]);
    }

    #[test]
    fn it_is_bounded() {
        let mut outbox = Outbox::default();
        for _ in 0..MAX_QUEUED {
            assert_eq!(outbox.push(message(Kind::Control, 0)), Ok(None));
        }
        assert_eq!(outbox.push(message(Kind::Control, 0)), Err(Full));
        for kind in [Kind::Swap, Kind::Frame, Kind::Alive].repeat(2) {
            outbox.push(message(kind, 1)).unwrap();
        }
        assert_eq!(outbox.waiting(), MAX_WAITING - 1);
        outbox.push(message(Kind::Bye, 2)).unwrap();
        assert_eq!(outbox.waiting(), MAX_WAITING - 1, "the goodbye took the frame's place");
    }
}
