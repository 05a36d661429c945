//! Peers that mean harm: strangers that say nothing, too much or nonsense, and a node of the wall that floods its master, lies, and never reads.

use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use mullion_common::scene::ChunkHash;
use mullion_common::wire::{
    ChunkHello, Hello, LENGTH_BYTES, MAX_WANTED, Opening, PROTOCOL_VERSION, Part, Ping, StandbyHello, ToMaster, ToTile, Want,
    WireError,
};
use mullion_server::generate::Random;

/// Longest that one attempt goes on.
const ATTEMPT: Duration = Duration::from_secs(1);
/// Between two attempts of one peer.
const PAUSE: Duration = Duration::from_millis(5);
/// Messages that a flood writes at once.
const VOLLEY: usize = 64;

/// Hostile peers at work; they stop when this is dropped.
pub struct HostilePeers {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
}

struct Shared {
    is_over: AtomicBool,
    attempts: AtomicU64,
    master: String,
}

impl HostilePeers {
    /// Sets so many strangers on a master, and one more that has a place in the wall.
    pub fn start(master: &str, strangers: u32, node: &str) -> Self {
        let (is_over, attempts) = (AtomicBool::new(false), AtomicU64::new(0));
        let shared = Arc::new(Shared { is_over, attempts, master: master.to_owned() });
        let stranger = |seed: u32| {
            let (shared, node) = (Arc::clone(&shared), node.to_owned());
            thread::spawn(move || {
                let mut random = Random::new(u64::from(seed));
                shared.go_on(&mut || shared.stranger(&mut random, &node));
            })
        };
        let mut threads: Vec<_> = (1..=strangers).map(stranger).collect();
        let (of_node, node) = (Arc::clone(&shared), node.to_owned());
        threads.push(thread::spawn(move || {
            let mut turn = 0;
            of_node.go_on(&mut || {
                turn += 1;
                of_node.node(&node, turn)
            });
        }));
        Self { shared, threads }
    }

    /// Connections that they have made.
    pub fn attempts(&self) -> u64 {
        self.shared.attempts.load(Ordering::Relaxed)
    }
}

impl Drop for HostilePeers {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join(); // what it did is over either way
        }
    }
}

impl Shared {
    fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    /// An attempt that is cut off has done its work.
    fn go_on(&self, attempt: &mut dyn FnMut() -> io::Result<()>) {
        while !self.is_over() {
            let _ = attempt();
            thread::sleep(PAUSE);
        }
    }

    fn connect(&self) -> io::Result<TcpStream> {
        let stream = TcpStream::connect(&self.master)?;
        self.attempts.fetch_add(1, Ordering::Relaxed);
        stream.set_write_timeout(Some(ATTEMPT))?;
        stream.set_read_timeout(Some(ATTEMPT))?;
        Ok(stream)
    }

    /// One connection of somebody who has no place here.
    fn stranger(&self, random: &mut Random, node: &str) -> io::Result<()> {
        let mut stream = self.connect()?;
        let hello = |part| Opening::Control(Hello { node: node.to_owned(), part, credentials: None, cached: vec![] });
        match random.bits() % 9 {
            0 => {} // says nothing
            1 => (0..64).try_for_each(|_| stream.write_all(&random.bits().to_le_bytes()))?,
            2 => stream.write_all(&u32::MAX.to_le_bytes())?,
            3 => {
                let greeting = message(|out| hello(Part::Own).encode(out))?;
                for byte in &greeting[..greeting.len() - 1] {
                    if self.is_over() {
                        break;
                    }
                    stream.write_all(&[*byte])?;
                    thread::sleep(Duration::from_millis(10));
                }
            }
            4 => stream.write_all(&message(|out| hello(Part::Own).encode_as_version(PROTOCOL_VERSION + 1, out))?)?,
            5 => stream.write_all(&message(|out| Opening::Chunks(ChunkHello { session: random.bits() }).encode(out))?)?,
            6 => {
                let [wall, scene] = [1, 2].map(|k| ChunkHash([k; 32]));
                stream.write_all(&message(|out| Opening::Standby(StandbyHello { wall, scene }).encode(out))?)?;
            }
            7 => return stream.shutdown(Shutdown::Both), // gone at once
            _ => stream.write_all(b"GET / HTTP/1.1\r\nHost: wall\r\n\r\n")?,
        }
        let mut answer = [0; 4096];
        let end = Instant::now() + ATTEMPT;
        while !self.is_over() && Instant::now() < end && stream.read(&mut answer)? > 0 {}
        Ok(())
    }

    /// One connection of a node of the wall, which means harm in its own way at each turn.
    fn node(&self, name: &str, turn: u64) -> io::Result<()> {
        let mut stream = self.connect()?;
        let hello = Hello { node: name.to_owned(), part: Part::Own, credentials: None, cached: vec![] };
        stream.write_all(&message(|out| Opening::Control(hello.clone()).encode(out))?)?;
        match turn % 4 {
            0 => self.flood(&mut stream, &message(|out| ToMaster::Ping(Ping { at_us: 1 }).encode(out))?),
            1 => self.flood(
                &mut stream,
                &message(|out| ToMaster::Ready { frame: 0, draw_us: 0, is_cut: false, shown: None }.encode(out))?,
            ),
            2 => {
                // It takes the last frame that there will ever be for drawn.
                stream.write_all(&message(|out| {
                    ToMaster::Ready { frame: u64::MAX, draw_us: 0, is_cut: false, shown: None }.encode(out)
                })?)?;
                stream.read_exact(&mut [0; 1])
            }
            _ => self.hoard(&mut stream),
        }
    }

    /// Says the same again and again, and never reads.
    fn flood(&self, stream: &mut TcpStream, message: &[u8]) -> io::Result<()> {
        let volley = message.repeat(VOLLEY);
        let end = Instant::now() + ATTEMPT;
        while !self.is_over() && Instant::now() < end {
            stream.write_all(&volley)?;
        }
        Ok(())
    }

    /// Wants the largest section again and again on a chunk connection that it does not read.
    fn hoard(&self, control: &mut TcpStream) -> io::Result<()> {
        let (mut session, mut hash) = (None, None);
        while hash.is_none() {
            let mut length = [0; LENGTH_BYTES];
            control.read_exact(&mut length)?;
            let mut body = vec![0; u32::from_le_bytes(length) as usize];
            control.read_exact(&mut body)?;
            match ToTile::decode(&body) {
                Ok(ToTile::Welcome(welcome)) => session = Some(welcome.session),
                Ok(ToTile::Manifest(manifest)) => {
                    hash = manifest.sections.iter().max_by_key(|section| section.length).map(|section| section.hash);
                }
                _ => {}
            }
        }
        let (Some(session), Some(hash)) = (session, hash) else { return Ok(()) };
        let mut chunks = self.connect()?;
        chunks.write_all(&message(|out| Opening::Chunks(ChunkHello { session }).encode(out))?)?;
        chunks.write_all(&message(|out| Want { hashes: vec![hash; MAX_WANTED] }.encode(out))?)?;
        let end = Instant::now() + ATTEMPT;
        while !self.is_over() && Instant::now() < end {
            thread::sleep(PAUSE);
        }
        Ok(())
    }
}

fn message(encode: impl FnOnce(&mut Vec<u8>) -> Result<(), WireError>) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    encode(&mut bytes).map_err(io::Error::other)?;
    Ok(bytes)
}
