//! The control API's sockets: HTTP and WebSocket on a thread of their own. The only user of axum and hyper.
//!
//! Browsers reach what listens on the loopback, too, and pages of strangers run in them: a request whose `Origin` or `Host`
//! is not this machine is refused.

use std::io;
use std::net::{IpAddr, TcpListener};
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use axum::body::{Body, to_bytes};
use axum::extract::rejection::QueryRejection;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Path, Query, Request, State};
use axum::http::{HeaderMap, StatusCode, Uri, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use mullion_common::control::{
    Answer, Ask, Command, Event, Inserted, MAX_REQUEST_BYTES, ObjectKey, Question, Request as Wanted, Status,
};
use serde::{Deserialize, Serialize};
use tokio::sync::{Semaphore, mpsc, oneshot, watch};

use super::board::Board;
use super::check::ControlError;
use super::queue::{Inlet, Subject};
use crate::metrics::MetricsReader;

/// Most connections; others are closed at once.
pub const MAX_CONNECTIONS: usize = 32;
/// Most WebSockets.
pub const MAX_SOCKETS: usize = 16;
/// How long a request may take to come in, and an answer to be taken.
const PATIENCE: Duration = Duration::from_secs(10);
/// How long a request waits for the frame that takes it.
const FRAME_PATIENCE: Duration = Duration::from_secs(5);
/// How long a request waits for its insertion, and those before it.
const INSERT_PATIENCE: Duration = Duration::from_secs(120);
/// Most bytes of a request's head.
const MAX_HEAD_BYTES: usize = 16 << 10;
/// Messages that wait to be written to a WebSocket; beyond, it is not read.
const MAX_UNSENT: usize = 16;

/// Who may ask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// Programs of this machine.
    Loopback,
    /// Whoever reaches the address: for networks of their own.
    Network,
}

/// The API, listening. Ends when dropped.
pub struct Server {
    stop: watch::Sender<bool>,
    thread: Option<JoinHandle<()>>,
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop.send_replace(true);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // it panicked: it is over, too
        }
    }
}

#[derive(Clone)]
struct Api {
    inlet: Inlet,
    board: Arc<Board>,
    metrics: Arc<MetricsReader>,
    reach: Reach,
    sockets: Arc<Semaphore>,
    stop: watch::Receiver<bool>,
}

/// Listens on a thread of its own.
///
/// # Errors
/// When the system gives no thread or runtime.
pub fn start(listener: TcpListener, inlet: Inlet, board: Arc<Board>, metrics: MetricsReader, reach: Reach) -> io::Result<Server> {
    let (stop, stopped) = watch::channel(false);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    listener.set_nonblocking(true)?;
    let sockets = Arc::new(Semaphore::new(MAX_SOCKETS));
    let api = Api { inlet, board, metrics: Arc::new(metrics), reach, sockets, stop: stopped };
    let serve = move || {
        runtime.block_on(async {
            match tokio::net::TcpListener::from_std(listener) {
                Ok(listener) => accept(listener, api).await,
                Err(error) => tracing::warn!("control: cannot listen: {error}"),
            }
        });
    };
    let thread = thread::Builder::new().name("control".to_owned()).spawn(serve)?;
    Ok(Server { stop, thread: Some(thread) })
}

async fn accept(listener: tokio::net::TcpListener, api: Api) {
    let mut stop = api.stop.clone();
    let permits = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    let router = Router::new()
        .route("/status", get(status))
        .route("/metrics", get(metrics))
        .route("/commands", post(commands))
        .route("/why", get(why))
        .route("/objects/{object}/tiles", get(tiles))
        .route("/ws", get(socket))
        .fallback(async || {
            refused(StatusCode::NOT_FOUND, "there is /status, /metrics, /commands, /why, /objects/ID/tiles and /ws")
        })
        .layer(middleware::from_fn_with_state(api.clone(), guard))
        .with_state(api);
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            _ = stop.wait_for(|stop| *stop) => return,
        };
        let stream = match accepted {
            Ok((stream, _)) => stream,
            Err(error) => {
                // Out of descriptors, most often: wait for some to be closed instead of spinning.
                tracing::warn!("control: cannot accept a connection: {error}");
                tokio::time::sleep(Duration::from_millis(10)).await;
                continue;
            }
        };
        let Ok(permit) = Arc::clone(&permits).try_acquire_owned() else {
            continue; // too many: closed
        };
        let _ = stream.set_nodelay(true); // slower, no more
        let service = TowerToHyperService::new(router.clone());
        tokio::spawn(async move {
            let connection = hyper::server::conn::http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(PATIENCE)
                .max_buf_size(MAX_HEAD_BYTES)
                .serve_connection(TokioIo::new(stream), service)
                .with_upgrades();
            if let Err(error) = connection.await {
                tracing::debug!("control: {error}");
            }
            // A WebSocket goes on in a task of its own, which hyper does not wait for: those are counted by themselves.
            drop(permit);
        });
    }
}

#[derive(Serialize)]
struct Problem {
    error: String,
}

fn refused(code: StatusCode, error: impl ToString) -> Response {
    (code, Json(Problem { error: error.to_string() })).into_response()
}

impl IntoResponse for ControlError {
    fn into_response(self) -> Response {
        let code = match self {
            Self::Full { .. } | Self::ManyInsertions => StatusCode::TOO_MANY_REQUESTS,
            Self::Late | Self::LateInsertion | Self::Over | Self::StandingBy => StatusCode::SERVICE_UNAVAILABLE,
            Self::TooLong(_) => StatusCode::PAYLOAD_TOO_LARGE,
            Self::NoObject { .. } | Self::NoObjectNamed { .. } | Self::NoTile { .. } => StatusCode::NOT_FOUND,
            _ => StatusCode::BAD_REQUEST,
        };
        refused(code, self)
    }
}

/// Refuses what a page of a stranger may have sent, and what is too long.
async fn guard(State(api): State<Api>, request: Request, next: Next) -> Response {
    if let Err(problem) = check_sender(request.headers(), api.reach) {
        return refused(StatusCode::FORBIDDEN, problem);
    }
    // Said beforehand: no need to wait for it.
    let length = request.headers().get(header::CONTENT_LENGTH).and_then(|length| length.to_str().ok()?.parse::<u64>().ok());
    if let Some(length) = length.filter(|length| *length > MAX_REQUEST_BYTES as u64) {
        return ControlError::TooLong(length as usize).into_response();
    }
    next.run(request).await
}

/// Names of hosts are a resolver's word, which a page's owner can change at will: only `localhost` and addresses count.
fn check_sender(headers: &HeaderMap, reach: Reach) -> Result<(), String> {
    let is_loopback = |host: &str| host == "localhost" || address(host).is_some_and(|ip| ip.is_loopback());
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok()?.parse::<axum::http::uri::Authority>().ok());
    let is_meant = host.as_ref().is_some_and(|host| match reach {
        Reach::Loopback => is_loopback(host.host()),
        Reach::Network => is_loopback(host.host()) || address(host.host()).is_some(),
    });
    if !is_meant {
        return Err("Host: not an address of this API; ask for it by number, or as localhost".to_owned());
    }
    for origin in headers.get_all(header::ORIGIN) {
        let uri = origin.to_str().ok().and_then(|origin| origin.parse::<Uri>().ok());
        if !uri.as_ref().and_then(Uri::host).is_some_and(is_loopback) {
            return Err("Origin: pages from elsewhere may not steer this wall".to_owned());
        }
    }
    Ok(())
}

fn address(host: &str) -> Option<IpAddr> {
    host.trim_start_matches('[').trim_end_matches(']').parse().ok()
}

async fn status(State(api): State<Api>) -> Json<Status> {
    Json(api.board.latest())
}

async fn metrics(State(api): State<Api>) -> Response {
    ([(header::CONTENT_TYPE, MetricsReader::CONTENT_TYPE)], api.metrics.text()).into_response()
}

#[derive(Serialize)]
struct Taken {
    frame: u64,
}

async fn commands(State(api): State<Api>, body: Body) -> Response {
    let body = match tokio::time::timeout(PATIENCE, to_bytes(body, MAX_REQUEST_BYTES)).await {
        Ok(Ok(body)) => body,
        Ok(Err(error)) => return refused(StatusCode::PAYLOAD_TOO_LARGE, format!("cannot read the request: {error}")),
        Err(_) => {
            let problem = format!("the request took longer than {} s", PATIENCE.as_secs());
            return refused(StatusCode::REQUEST_TIMEOUT, problem);
        }
    };
    let receipt = parse::<Vec<Command>>(&body).and_then(|commands| api.submit(&commands));
    let answer = match receipt {
        Ok(receipt) => receipt.answer().await,
        Err(error) => Err(error),
    };
    match answer {
        Ok(Answer::Frame(frame)) => Json(Taken { frame }).into_response(),
        Ok(Answer::Inserted(inserted)) => Json(inserted).into_response(),
        Ok(_) => refused(StatusCode::INTERNAL_SERVER_ERROR, "another question was answered"),
        Err(error) => error.into_response(),
    }
}

#[derive(Deserialize)]
struct Pair {
    object: String,
    tile: String,
}

async fn why(State(api): State<Api>, pair: Result<Query<Pair>, QueryRejection>) -> Response {
    let Ok(Query(pair)) = pair else {
        return refused(StatusCode::BAD_REQUEST, "ask as /why?object=ID&tile=NAME");
    };
    match api.why(&key(pair.object), &pair.tile).await {
        Ok(Answer::Why(why)) => Json(why).into_response(),
        Ok(_) => refused(StatusCode::INTERNAL_SERVER_ERROR, "another question was answered"),
        Err(error) => error.into_response(),
    }
}

async fn tiles(State(api): State<Api>, Path(object): Path<String>) -> Response {
    match api.tiles(&key(object)).await {
        Ok(Answer::Tiles(tiles)) => Json(tiles).into_response(),
        Ok(_) => refused(StatusCode::INTERNAL_SERVER_ERROR, "another question was answered"),
        Err(error) => error.into_response(),
    }
}

/// In an address, digits are a number.
fn key(text: String) -> ObjectKey {
    text.parse().map_or(ObjectKey::Name(text), ObjectKey::Number)
}

fn parse<T: for<'de> Deserialize<'de>>(bytes: &[u8]) -> Result<T, ControlError> {
    serde_json::from_slice(bytes).map_err(|error| ControlError::Malformed(error.to_string()))
}

impl Api {
    /// Queues commands at once; what comes later tells their frame.
    fn submit(&self, commands: &[Command]) -> Result<Receipt, ControlError> {
        if let [Command::Insert(insert)] = commands {
            let (ended, inserted) = oneshot::channel();
            self.inlet.insert(insert, Box::new(|result| drop(ended.send(result))))?;
            return Ok(Receipt::Insertion(inserted));
        }
        let (taken, frame) = oneshot::channel();
        // Whoever asked may be gone when the frame comes.
        self.inlet.submit(commands, Box::new(|number| taken.send(number).unwrap_or_default()))?;
        Ok(Receipt::Frame(frame))
    }

    async fn why(&self, object: &ObjectKey, tile: &str) -> Result<Answer, ControlError> {
        let checker = self.inlet.checker();
        let subject = Subject::Tile(checker.object(object)?, checker.tile(tile)?);
        let snapshot = self.snapshot(subject).await?;
        snapshot.why(checker.wall()).map(Answer::Why).ok_or(ControlError::Over)
    }

    async fn tiles(&self, object: &ObjectKey) -> Result<Answer, ControlError> {
        let checker = self.inlet.checker();
        let snapshot = self.snapshot(Subject::Wall(checker.object(object)?)).await?;
        snapshot.seen_by(checker.wall()).map(Answer::Tiles).ok_or(ControlError::Over)
    }

    async fn snapshot(&self, subject: Subject) -> Result<super::why::Snapshot, ControlError> {
        let (taken, snapshot) = oneshot::channel();
        self.inlet.ask(subject, Box::new(|snapshot| drop(taken.send(snapshot))))?;
        in_time(snapshot).await
    }

    /// Takes a text message; commands are queued at once, so that they keep their place among messages of moves.
    fn begin(&self, text: &str) -> Pending {
        match parse::<Wanted>(text.as_bytes()) {
            Ok(Wanted { id, ask: Ask::Commands(commands) }) => Pending::Commands(id, self.submit(&commands)),
            Ok(Wanted { id, ask: Ask::Why(question) }) => Pending::Why(id, question),
            Ok(Wanted { id, ask: Ask::Tiles(object) }) => Pending::Tiles(id, object),
            Err(error) => Pending::Refused(error),
        }
    }

    /// What it is answered with.
    async fn finish(&self, pending: Pending) -> Event {
        let (id, answer) = match pending {
            Pending::Commands(id, Ok(receipt)) => (id, receipt.answer().await),
            Pending::Commands(id, Err(error)) => (id, Err(error)),
            Pending::Why(id, question) => (id, self.why(&question.object, &question.tile).await),
            Pending::Tiles(id, object) => (id, self.tiles(&object).await),
            Pending::Refused(error) => return Event::Refused { id: None, error: error.to_string() },
        };
        match answer {
            Ok(answer) => Event::Answer { id, answer },
            Err(error) => Event::Refused { id: Some(id), error: error.to_string() },
        }
    }
}

/// What tells what became of commands.
enum Receipt {
    Frame(oneshot::Receiver<u64>),
    Insertion(oneshot::Receiver<Result<Inserted, ControlError>>),
}

impl Receipt {
    async fn answer(self) -> Result<Answer, ControlError> {
        match self {
            Self::Frame(frame) => in_time(frame).await.map(Answer::Frame),
            Self::Insertion(inserted) => match tokio::time::timeout(INSERT_PATIENCE, inserted).await {
                Ok(Ok(result)) => result.map(Answer::Inserted),
                Ok(Err(_)) => Err(ControlError::Over),
                Err(_) => Err(ControlError::LateInsertion),
            },
        }
    }
}

/// A text message on its way to an answer.
enum Pending {
    Commands(u64, Result<Receipt, ControlError>),
    Why(u64, Question),
    Tiles(u64, ObjectKey),
    Refused(ControlError),
}

async fn in_time<T>(receiver: oneshot::Receiver<T>) -> Result<T, ControlError> {
    match tokio::time::timeout(FRAME_PATIENCE, receiver).await {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(_)) => Err(ControlError::Over),
        Err(_) => Err(ControlError::Late),
    }
}

async fn socket(State(api): State<Api>, upgrade: WebSocketUpgrade) -> Response {
    let Ok(permit) = Arc::clone(&api.sockets).try_acquire_owned() else {
        return refused(StatusCode::SERVICE_UNAVAILABLE, format!("{MAX_SOCKETS} WebSockets are open"));
    };
    upgrade.max_message_size(MAX_REQUEST_BYTES).max_frame_size(MAX_REQUEST_BYTES).on_upgrade(async move |socket| {
        talk(api, socket).await;
        drop(permit);
    })
}

/// Answers one message after the other, and tells how the show stands meanwhile.
async fn talk(api: Api, mut socket: WebSocket) {
    let mut stop = api.stop.clone();
    let (answers, mut answered) = mpsc::channel::<Event>(MAX_UNSENT);
    let (asked, mut asks) = mpsc::channel::<Pending>(MAX_UNSENT);
    let answering = api.clone();
    // On its own: a message that waits for its frame holds up no status, and no moves.
    tokio::spawn(async move {
        while let Some(pending) = asks.recv().await {
            if let Pending::Commands(_, Ok(Receipt::Insertion(_))) = pending {
                // It takes long, and others are not to wait behind it. The queue of insertions bounds how many there are.
                let (answering, answers) = (answering.clone(), answers.clone());
                tokio::spawn(async move {
                    let _ = answers.send(answering.finish(pending).await).await; // nobody there: nobody to tell
                });
                continue;
            }
            if answers.send(answering.finish(pending).await).await.is_err() {
                return;
            }
        }
    });
    let mut seen = 0;
    loop {
        let event = tokio::select! {
            biased;
            _ = stop.wait_for(|stop| *stop) => return,
            Some(event) = answered.recv() => event,
            message = socket.recv() => match message {
                Some(Ok(Message::Text(text))) => match asked.try_reserve() {
                    Ok(place) => {
                        place.send(api.begin(&text));
                        continue;
                    }
                    Err(_) => Event::Refused { id: None, error: format!("{MAX_UNSENT} requests wait for answers: send fewer") },
                },
                Some(Ok(Message::Binary(bytes))) => match api.inlet.submit_moves(&bytes, Box::new(|_| {})) {
                    Ok(()) => continue,
                    Err(error) => Event::Refused { id: None, error: error.to_string() },
                },
                Some(Ok(_)) => continue,
                Some(Err(_)) | None => return,
            },
            status = api.board.after(seen) => {
                seen = status.frames;
                Event::Status(status)
            }
        };
        let Ok(text) = serde_json::to_string(&event) else { return };
        let sent = tokio::time::timeout(PATIENCE, socket.send(Message::Text(text.into()))).await;
        if !matches!(sent, Ok(Ok(()))) {
            return; // gone, or it does not read
        }
    }
}
