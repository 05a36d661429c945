//! Who takes part: masters and nodes as they are, over the simulated network.

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::{Arc, OnceLock};

use glam::{DAffine3, DVec3};
use mullion_client::missing::WhenMissing;
use mullion_client::node::{Connector as NodeConnector, NodeOptions, Reconnect, Security, Stream};
use mullion_client::protocol_node::run_observed;
use mullion_common::scene::{ObjectId, Package, Tessellation, TessellationParts};
use mullion_common::wall::{Wall, WallConfig};
use mullion_common::wire::{Moved, Part};
use mullion_server::service::{Connector, Listener, Pose, Show, ShowBudget, ShowOptions, Socket, serve_over};
use tokio::sync::watch;
use turmoil::net::{TcpListener, TcpStream};

use crate::observed::Shared;
use crate::session_support::{OBJECTS, package, transform, visible};

pub const LEAVES: u32 = 200;
pub const RATE_HZ: f64 = 60.0;
pub const PORT: u16 = 7411;
/// Of the two triangles of each leaf, on every master.
const BUDGET_PERCENT: f64 = 25.0;
pub const BUDGET_TRIANGLES: u32 = 2 * LEAVES / 4;
/// The hosts of masters: the first begins the show, the second stands by.
pub const MASTERS: [&str; 2] = ["master-a", "master-b"];

/// A wall of `columns × rows` tiles, each driven by a node of its name.
pub fn wall([columns, rows]: [u32; 2]) -> Arc<Wall> {
    let grid = format!("columns = {columns}\nrows = {rows}\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n");
    Arc::new(WallConfig::parse(&format!("rate_hz = {RATE_HZ}\n[grid]\n{grid}")).expect("a valid wall"))
}

fn scene() -> Arc<Package> {
    static SCENE: OnceLock<Arc<Package>> = OnceLock::new();
    let with_tessellation = || {
        let mut package = Arc::unwrap_or_clone(package(LEAVES));
        let tessellation = Tessellation::new(TessellationParts::default(), &package.scene.manifest);
        package.scene.tessellation = Some(Arc::new(tessellation.expect("it names nothing")));
        Arc::new(package)
    };
    Arc::clone(SCENE.get_or_init(with_tessellation))
}

/// What a master's host is to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Nothing: its process is dead.
    Nothing,
    /// A show of its own.
    Begin,
    /// The same, when the other master is gone.
    StandBy,
}

/// A process that is started and killed as it is told; its machine stays.
pub async fn master(host: usize, wall: Arc<Wall>, mut orders: watch::Receiver<Order>, observed: Shared) -> turmoil::Result {
    let stop = observed.lock().expect("nobody panicked").stop.clone();
    loop {
        let order = *orders.wait_for(|order| *order != Order::Nothing).await?;
        let listener = Network(TcpListener::bind((Ipv4Addr::UNSPECIFIED, PORT)).await?);
        let show = show(host, &wall, order, stop.clone(), &observed);
        tokio::select! {
            biased;
            gone = orders.wait_for(|order| *order == Order::Nothing) => drop(gone?),
            report = serve_over(listener, show) => {
                let report = report?;
                return observed.lock().expect("nobody panicked").ended(host, &report);
            }
        }
    }
}

struct Network(TcpListener);

impl Listener for Network {
    async fn accept(&self) -> io::Result<(Socket, SocketAddr)> {
        let (stream, address) = self.0.accept().await?;
        let (reader, writer) = stream.into_split();
        Ok((Socket { reader: Box::new(reader), writer: Box::new(writer) }, address))
    }

    fn port(&self) -> io::Result<u16> {
        Ok(self.0.local_addr()?.port())
    }
}

fn show(host: usize, wall: &Arc<Wall>, order: Order, stop: watch::Receiver<bool>, observed: &Shared) -> Show {
    let (seed, reign) = {
        let mut observed = observed.lock().expect("nobody panicked");
        (observed.seed, observed.begin_reign(host))
    };
    let [of_frames, of_nodes] = [Arc::clone(observed), Arc::clone(observed)];
    let eyes = wall.default_eyes();
    let connect = |to: String| {
        Box::pin(async move {
            let (reader, writer) = TcpStream::connect(to).await?.into_split();
            Ok(Socket { reader: Box::new(reader), writer: Box::new(writer) })
        }) as mullion_server::service::Connecting
    };
    Show {
        options: ShowOptions {
            standby_of: (order == Order::StandBy).then(|| format!("{}:{PORT}", MASTERS[1 - host])),
            connector: Connector::new(connect),
            session_seed: Some([seed as u8; 32]),
            // Nodes without a scene count nothing, so that nothing is dropped; who means harm does.
            adaptive: Some(0.01),
            budget: Some(ShowBudget::Percent(BUDGET_PERCENT)),
            ..ShowOptions::for_wall(wall)
        },
        wall: Arc::clone(wall),
        package: scene(),
        camera: Box::new(move |number| {
            let object = (number % u64::from(OBJECTS)) as u32;
            Pose {
                scene_time_s: number as f64 / RATE_HZ,
                world_from_room: DAffine3::from_translation(DVec3::new(number as f64, 0.0, 0.0)),
                eyes: eyes.clone(),
                moved: vec![Moved { object: ObjectId(object), transform: transform(object, number) }],
                ..Pose::default()
            }
        }),
        cull: Box::new(move |pose, sets| {
            let number = (pose.scene_time_s * RATE_HZ).round() as u64;
            sets.iter_mut().enumerate().for_each(|(view, set)| *set = visible(seed, number, view, LEAVES));
        }),
        observer: Box::new(move |frame| of_frames.lock().expect("nobody panicked").released(reign, frame)),
        node_observer: Box::new(move |event| of_nodes.lock().expect("nobody panicked").node_event(reign, event)),
        shown_observer: Box::new(|_, _| {}),
        stop: Some(stop),
    }
}

/// A node that is no more than its protocol, until the show ends.
pub async fn node(player: usize, name: String, part: Part, masters: usize, observed: Shared) -> turmoil::Result {
    let connect = |to: String| {
        Box::pin(async move {
            let (reader, writer) = TcpStream::connect(to).await?.into_split();
            Ok(Stream { reader: Box::new(reader), writer: Box::new(writer) })
        }) as mullion_client::node::Connecting
    };
    let options = NodeOptions {
        masters: MASTERS.iter().take(masters).map(|host| format!("{host}:{PORT}")).collect(),
        connector: NodeConnector::new(connect),
        security: Security::Plain,
        node: name,
        part,
        credentials: None,
        memory_bytes: 0,
        when_missing: WhenMissing::Hold,
        cache: None,
        reconnect: Reconnect::default(),
        stop: None,
    };
    observed.lock().expect("nobody panicked").starts(player);
    let observe = Arc::clone(&observed);
    run_observed(options, move |step| observe.lock().expect("nobody panicked").step(player, &step)).await?;
    observed.lock().expect("nobody panicked").leaves(player);
    Ok(())
}
