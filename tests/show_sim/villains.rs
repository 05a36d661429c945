//! Those who mean harm, or are broken: strangers, and a node of the wall.

use std::future::pending;
use std::io;
use std::time::Duration;

use mullion_common::scene::{ChunkHash, ObjectId};
use mullion_common::wall::ViewId;
use mullion_common::wire::{
    ChunkHello, Counted, Hello, LENGTH_BYTES, MAX_COUNTED, MAX_WANTED, ObjectCount, Opening, PROTOCOL_VERSION, Part, Ping,
    StandbyHello, ToMaster, ToTile, Want, WireError,
};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::time::{sleep, timeout};
use turmoil::Sim;
use turmoil::net::TcpStream;

use crate::cast::{MASTERS, PORT};
use crate::plan::{LAST_STRIKE, Plan};
use crate::session_support::random::Random;

/// How long a stranger with another node's name goes on: the name must be free again soon.
const THEFT: Duration = Duration::from_millis(100);

/// What a stranger's host is called.
pub fn name(stranger: usize) -> String {
    format!("stranger{stranger}")
}

/// A node of the wall that means harm, in another way each time it connects.
pub fn take_place(sim: &mut Sim<'_>, plan: &Plan, name: &str, masters: usize) {
    let (seed, node) = (plan.seed ^ 0xbad << 32, name.to_owned());
    sim.host(name, move || {
        let node = node.clone();
        async move {
            let mut rng = Random(seed);
            go_on(&mut rng, masters, async |stream, rng| be_a_bad_node(stream, rng, &node).await).await
        }
    });
}

/// Somebody who has no place here.
pub fn come_by(sim: &mut Sim<'_>, plan: &Plan, stranger: usize, names: &[String], masters: usize) {
    let (seed, names) = (plan.seed ^ (0x57a + stranger as u64) << 32, names.to_vec());
    sim.host(name(stranger), move || {
        let names = names.clone();
        async move {
            let mut rng = Random(seed);
            go_on(&mut rng, masters, async |stream, rng| be_a_stranger(stream, rng, &names).await).await
        }
    });
}

/// One connection after the other; what ends one is of no interest.
async fn go_on(
    rng: &mut Random,
    masters: usize,
    attempt: impl AsyncFn(TcpStream, &mut Random) -> io::Result<()>,
) -> turmoil::Result {
    while let Some(left) = LAST_STRIKE.checked_sub(turmoil::sim_elapsed().expect("in a simulation")) {
        let master = MASTERS[rng.within(0, masters as u64) as usize];
        let longest = left.min(Duration::from_millis(rng.within(20, 2500)));
        let _ = timeout(longest, async {
            let stream = TcpStream::connect((master, PORT)).await?;
            attempt(stream, rng).await
        })
        .await;
        sleep(Duration::from_millis(rng.within(2, 60))).await;
    }
    Ok(())
}

async fn be_a_stranger(mut stream: TcpStream, rng: &mut Random, names: &[String]) -> io::Result<()> {
    let node = names[rng.within(0, names.len() as u64) as usize].clone();
    let hello = Opening::Control(Hello { node, part: Part::Own, credentials: None, cached: vec![] });
    match rng.within(0, 9) {
        0 => {} // says nothing
        1 => stream.write_all(&noise(rng, 500)).await?,
        2 => stream.write_all(&u32::MAX.to_le_bytes()).await?,
        3 => {
            let greeting = message(|out| hello.encode(out))?;
            for byte in &greeting[..greeting.len() - 1] {
                stream.write_all(&[*byte]).await?;
                sleep(Duration::from_millis(10)).await;
            }
        }
        4 => stream.write_all(&message(|out| hello.encode_as_version(PROTOCOL_VERSION + 1, out))?).await?,
        5 => stream.write_all(&message(|out| Opening::Chunks(ChunkHello { session: rng.next() }).encode(out))?).await?,
        6 => {
            let [wall, scene] = [1, 2].map(|k| ChunkHash([k; 32]));
            stream.write_all(&message(|out| Opening::Standby(StandbyHello { wall, scene }).encode(out))?).await?;
        }
        7 => {
            stream.write_all(&message(|out| hello.encode(out))?).await?;
            return timeout(THEFT, drain(&mut stream)).await?;
        }
        _ => return Ok(()), // gone at once
    }
    drain(&mut stream).await
}

async fn be_a_bad_node(mut stream: TcpStream, rng: &mut Random, node: &str) -> io::Result<()> {
    let hello = Hello { node: node.to_owned(), part: Part::Own, credentials: None, cached: vec![] };
    stream.write_all(&message(|out| Opening::Control(hello).encode(out))?).await?;
    match rng.within(0, 12) {
        0 => pending().await, // neither reads nor writes
        1 => stream.write_all(&noise(rng, 2000)).await?,
        2 => stream.write_all(&message(|out| ready(u64::MAX).encode(out))?).await?,
        3 => {
            let frame = loop {
                if let body @ (_, ToTile::Frame(_)) = next(&mut stream).await? {
                    break body.0;
                }
            };
            stream.write_all(&(frame.len() as u32).to_le_bytes()).await?;
            stream.write_all(&frame).await?;
        }
        4 => stream.write_all(&(u32::MAX - 3).to_le_bytes()).await?,
        5 => loop {
            next(&mut stream).await?;
            sleep(Duration::from_millis(100)).await;
        },
        6 => {
            // In step for a while: it is waited for when it stops.
            for _ in 0..rng.within(5, 60) {
                if let ToTile::Frame(frame) = next(&mut stream).await?.1 {
                    stream.write_all(&message(|out| ready(frame.number).encode(out))?).await?;
                }
            }
        }
        7 => loop {
            stream.write_all(&message(|out| ToMaster::Ping(Ping { at_us: 1 }).encode(out))?).await?;
        },
        8 => return hoard(&mut stream).await,
        9 | 10 => return miscount(&mut stream, rng).await,
        _ => loop {
            stream.write_all(&message(|out| ready(0).encode(out))?).await?;
            sleep(Duration::from_millis(1)).await;
        },
    }
    drain(&mut stream).await
}

/// Says of every frame, many times over, that next to nothing is to be seen of any object, there or not; in the end of somebody else's tile.
async fn miscount(stream: &mut TcpStream, rng: &mut Random) -> io::Result<()> {
    let mut view = ViewId(u16::MAX);
    for _ in 0..rng.within(5, 60) {
        match next(stream).await?.1 {
            ToTile::Welcome(welcome) => view = welcome.views[0].view,
            ToTile::Frame(frame) => {
                stream.write_all(&message(|out| ready(frame.number).encode(out))?).await?;
                let distance_m = rng.between(-1e9, 1e9) as f32;
                let count = |object| ObjectCount { object: ObjectId(object), visible_px: rng.next() as u32 % 2, distance_m };
                let counted = Counted { frame: frame.number, view, objects: (0..MAX_COUNTED as u32).map(count).collect() };
                let body = message(|out| ToMaster::Counted(counted).encode(out))?;
                for _ in 0..20 {
                    stream.write_all(&body).await?;
                }
            }
            _ => {}
        }
    }
    let counted = Counted { frame: 0, view: ViewId(view.0.wrapping_add(1)), objects: Vec::new() };
    stream.write_all(&message(|out| ToMaster::Counted(counted).encode(out))?).await?;
    drain(stream).await
}

/// Wants the largest section again and again on a chunk connection that it does not read.
async fn hoard(control: &mut TcpStream) -> io::Result<()> {
    let master = control.peer_addr()?;
    let (mut session, mut hash) = (None, None);
    while hash.is_none() {
        match next(control).await?.1 {
            ToTile::Welcome(welcome) => session = Some(welcome.session),
            ToTile::Manifest(manifest) => hash = manifest.sections.iter().max_by_key(|s| s.length).map(|s| s.hash),
            _ => {}
        }
    }
    let (Some(session), Some(hash)) = (session, hash) else { return Ok(()) };
    let mut chunks = TcpStream::connect(master).await?;
    chunks.write_all(&message(|out| Opening::Chunks(ChunkHello { session }).encode(out))?).await?;
    chunks.write_all(&message(|out| Want { hashes: vec![hash; MAX_WANTED] }.encode(out))?).await?;
    pending().await
}

fn ready(frame: u64) -> ToMaster {
    ToMaster::Ready { frame, draw_us: 0, is_cut: false, shown: None }
}

fn noise(rng: &mut Random, most: u64) -> Vec<u8> {
    (0..rng.within(1, most)).map(|_| rng.next() as u8).collect()
}

/// The next message and its body.
async fn next(stream: &mut TcpStream) -> io::Result<(Vec<u8>, ToTile)> {
    let mut length = [0; LENGTH_BYTES];
    stream.read_exact(&mut length).await?;
    let mut body = vec![0; u32::from_le_bytes(length) as usize];
    stream.read_exact(&mut body).await?;
    let message = ToTile::decode(&body).map_err(io::Error::other)?;
    Ok((body, message))
}

async fn drain(stream: &mut TcpStream) -> io::Result<()> {
    let mut waste = [0; 4096];
    while stream.read(&mut waste).await? > 0 {}
    Ok(())
}

fn message(encode: impl FnOnce(&mut Vec<u8>) -> Result<(), WireError>) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    encode(&mut bytes).map_err(io::Error::other)?;
    Ok(bytes)
}
