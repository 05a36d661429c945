//! Steers a running Mullion wall: a blocking client of the control API that `mullion serve --control ADDRESS` offers.
//!
//! ```no_run
//! use mullion_control::{Command, Control, ObjectNumber};
//!
//! let mut control = Control::connect("127.0.0.1:7468")?;
//! let frame = control.send(&[Command::Pause, Command::Remove(ObjectNumber { object: 12 })])?;
//! println!("holds from frame {frame}; {:?}", control.why("12", "t0x0")?);
//! # Ok::<(), mullion_control::Error>(())
//! ```

use std::io;
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use mullion_common::control::{Answer, Ask, Event, MAX_REQUEST_BYTES, Request, encode_moves};
pub use mullion_common::control::{
    CameraAt, Command, Insert, Inserted, LeafWhy, MAX_COMMANDS, MAX_MOVES, MoveObject, NodeStanding, NodeStatus, ObjectKey,
    ObjectNumber, ObjectRange, Question, Reason, SeenBy, Side, Status, Steps, TileBudget, Why,
};
pub use mullion_common::scene::{ObjectId, Transform};
pub use mullion_common::wire::Moved;
use thiserror::Error;
use tungstenite::protocol::WebSocketConfig;
use tungstenite::{HandshakeError, Message, WebSocket};

/// How long the master may say nothing; it tells of every frame.
pub const PATIENCE: Duration = Duration::from_secs(15);

/// Why the master did not do or tell what it was asked.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum Error {
    #[error("cannot reach the control API: {0}")]
    Connect(io::Error),
    #[error("no control API there: {0}")]
    Handshake(String),
    #[error("connection: {0}")]
    Connection(Box<tungstenite::Error>),
    #[error("refused: {0}")]
    Refused(String),
    #[error("not understood: {0}; use the release of the master")]
    Malformed(String),
}

impl From<tungstenite::Error> for Error {
    fn from(error: tungstenite::Error) -> Self {
        Self::Connection(Box::new(error))
    }
}

/// A connection to a show's control API.
#[derive(Debug)]
pub struct Control {
    socket: WebSocket<TcpStream>,
    next_id: u64,
    status: Status,
    bytes: Vec<u8>,
}

impl Control {
    /// Connects.
    ///
    /// # Errors
    /// When nobody listens there, or no control API does.
    pub fn connect(address: impl ToSocketAddrs) -> Result<Self, Error> {
        let stream = TcpStream::connect(address).map_err(Error::Connect)?;
        let set_up = |stream: &TcpStream| {
            stream.set_nodelay(true)?;
            stream.set_read_timeout(Some(PATIENCE))?;
            stream.set_write_timeout(Some(PATIENCE))?;
            stream.peer_addr()
        };
        let peer = set_up(&stream).map_err(Error::Connect)?;
        let config = WebSocketConfig::default().max_message_size(Some(MAX_REQUEST_BYTES)).max_frame_size(Some(MAX_REQUEST_BYTES));
        let opened = tungstenite::client::client_with_config(format!("ws://{peer}/ws"), stream, Some(config));
        let (socket, _) = opened.map_err(|error| match error {
            HandshakeError::Failure(error) => Error::Handshake(error.to_string()),
            HandshakeError::Interrupted(_) => Error::Handshake("it does not answer".to_owned()),
        })?;
        Ok(Self { socket, next_id: 1, status: Status::default(), bytes: Vec::new() })
    }

    /// Has commands done in one frame, all of them, and waits until it takes them: the frame from which they hold.
    ///
    /// # Errors
    /// When one of them cannot be done (then none is), or the connection is lost.
    pub fn send(&mut self, commands: &[Command]) -> Result<u64, Error> {
        match self.ask(Ask::Commands(commands.to_vec()))? {
            Answer::Frame(frame) => Ok(frame),
            other => Err(Error::Malformed(format!("{other:?}"))),
        }
    }

    /// Adds a package of the master's library to the scene, and waits until it is seen. That takes many frames, which go on meanwhile.
    ///
    /// # Errors
    /// When it cannot be done, or the connection is lost.
    pub fn insert(&mut self, insert: &Insert) -> Result<Inserted, Error> {
        match self.ask(Ask::Commands(vec![Command::Insert(insert.clone())]))? {
            Answer::Inserted(inserted) => Ok(inserted),
            other => Err(Error::Malformed(format!("{other:?}"))),
        }
    }

    /// Moves objects, all in one frame: at most [`MAX_MOVES`]. Does not wait; what is refused is the error of a later call.
    ///
    /// # Errors
    /// When the connection is lost.
    pub fn move_objects(&mut self, moves: &[Moved]) -> Result<(), Error> {
        encode_moves(moves, &mut self.bytes);
        self.socket.send(Message::Binary(self.bytes.clone().into()))?;
        Ok(())
    }

    /// Why a tile sees an object and all below it, or does not. `object` is a number or a name.
    ///
    /// # Errors
    /// When there is no such object or tile, or the connection is lost.
    pub fn why(&mut self, object: &str, tile: &str) -> Result<Why, Error> {
        match self.ask(Ask::Why(Question { object: key(object), tile: tile.to_owned() }))? {
            Answer::Why(why) => Ok(why),
            other => Err(Error::Malformed(format!("{other:?}"))),
        }
    }

    /// Which tiles see an object or anything below it. `object` is a number or a name.
    ///
    /// # Errors
    /// When there is no such object, or the connection is lost.
    pub fn tiles(&mut self, object: &str) -> Result<SeenBy, Error> {
        match self.ask(Ask::Tiles(key(object)))? {
            Answer::Tiles(tiles) => Ok(tiles),
            other => Err(Error::Malformed(format!("{other:?}"))),
        }
    }

    /// The newest status that has come in; before the first, an empty one.
    pub fn status(&self) -> &Status {
        &self.status
    }

    /// Waits for the next status. The master tells one a frame, and leaves some out for those who read slowly.
    ///
    /// # Errors
    /// When something sent before was refused, or the connection is lost.
    pub fn next_status(&mut self) -> Result<&Status, Error> {
        loop {
            match self.event()? {
                Event::Status(status) => {
                    self.status = status;
                    return Ok(&self.status);
                }
                Event::Refused { error, .. } => return Err(Error::Refused(error)),
                Event::Answer { .. } => {} // to a call that ended with an error
            }
        }
    }

    fn ask(&mut self, ask: Ask) -> Result<Answer, Error> {
        let id = self.next_id;
        self.next_id += 1;
        let text = serde_json::to_string(&Request { id, ask }).map_err(|error| Error::Malformed(error.to_string()))?;
        self.socket.send(Message::Text(text.into()))?;
        loop {
            match self.event()? {
                Event::Status(status) => self.status = status,
                Event::Answer { id: of, answer } if of == id => return Ok(answer),
                // Without a number: of moves that were sent before, or of this one, where it could not be read.
                Event::Refused { id: of, error } if of.is_none_or(|of| of == id) => return Err(Error::Refused(error)),
                Event::Answer { .. } | Event::Refused { .. } => {} // to a call that ended with an error
            }
        }
    }

    fn event(&mut self) -> Result<Event, Error> {
        loop {
            if let Message::Text(text) = self.socket.read()? {
                return serde_json::from_str(&text).map_err(|error| Error::Malformed(error.to_string()));
            }
        }
    }
}

fn key(object: &str) -> ObjectKey {
    object.parse().map_or_else(|_| ObjectKey::Name(object.to_owned()), ObjectKey::Number)
}
