//! What a show does, as Prometheus reads it: counters, gauges and histograms that a frame updates without waiting for a reader.

use std::time::Duration;

use mullion_common::wall::Wall;
use mullion_common::wire::Shown;
use prometheus_client::encoding::{EncodeLabelSet, text};
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::registry::{Registry, Unit};

use crate::service::{FrameReport, NodeEvent};
use crate::swap_barrier::NodeIndex;

/// From 20 µs in steps of a fifth to more than a second: a percentile, 99.9 too, is known to a tenth.
const FIRST_BUCKET_S: f64 = 20e-6;
const BUCKET_STEP: f64 = 1.2;
const BUCKETS: u16 = 61;
/// How many frames back a node may still say that it showed one.
const SKEW_FRAMES: usize = 16;

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct OfNode {
    node: String,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct OfStage {
    stage: &'static str,
}

/// One node's.
#[derive(Debug)]
struct NodeMetrics {
    passed_over: Counter,
    frame_bytes: Counter,
    draw_us: Gauge,
    leaves: Gauge,
    triangles: Gauge,
    resident_bytes: Gauge,
}

/// When a frame was shown, as far as is known.
#[derive(Clone, Copy, Debug, Default)]
struct ShownAt {
    frame: u64,
    nodes: u32,
    first_us: u64,
    last_us: u64,
}

/// Takes down what happens: the writing side, which belongs to the show.
#[derive(Debug)]
pub struct Metrics {
    frames: Counter,
    stages: [Histogram; 4],
    waited: Histogram,
    skew: Histogram,
    connected: Gauge,
    shown_by: Gauge,
    dropped: Gauge,
    budget: Gauge,
    over_budget: Counter,
    joined: Counter,
    left: Counter,
    stood_in: Counter,
    chunk_bytes: Counter,
    chunk_bytes_before: u64,
    nodes: Vec<NodeMetrics>,
    shown: [ShownAt; SKEW_FRAMES],
}

/// Tells what was taken down: the reading side.
#[derive(Debug)]
pub struct MetricsReader(Registry);

impl Metrics {
    /// For a wall: both sides, all at zero.
    pub fn new(wall: &Wall) -> (Self, MetricsReader) {
        let mut registry = Registry::with_prefix("mullion");
        let histogram = || Histogram::new(exponential_buckets(FIRST_BUCKET_S, BUCKET_STEP, BUCKETS));
        let stages = Family::<OfStage, Histogram, _>::new_with_constructor(histogram as fn() -> Histogram);
        let (waited, skew) = (histogram(), histogram());
        let [frames, over_budget, joined, left, stood_in, chunk_bytes] = std::array::from_fn(|_| Counter::default());
        let [connected, shown_by, dropped, budget] = std::array::from_fn(|_| Gauge::default());
        registry.register("frames", "Frames released", frames.clone());
        registry.register_with_unit("frame_stage", "The master's work on a frame", Unit::Seconds, stages.clone());
        registry.register_with_unit("frame_wait", "From a frame's beginning to its release", Unit::Seconds, waited.clone());
        registry.register_with_unit(
            "swap_skew",
            "From the first node that showed a frame to the last",
            Unit::Seconds,
            skew.clone(),
        );
        registry.register("nodes_connected", "Nodes that are connected", connected.clone());
        registry.register("nodes_showing", "Nodes that were told to show the newest frame", shown_by.clone());
        registry.register(
            "objects_dropped",
            "Objects that no tile draws in the newest frame because they hardly contribute",
            dropped.clone(),
        );
        registry.register(
            "budget_triangles",
            "Triangles that the newest frame's estimate may spend; 0 where all is drawn",
            budget.clone(),
        );
        registry.register(
            "frames_over_budget",
            "Frames whose slowest node took longer than the budget's time",
            over_budget.clone(),
        );
        registry.register("node_joins", "Connections of nodes that were greeted", joined.clone());
        registry.register("node_losses", "Connections of nodes that ended", left.clone());
        registry.register("spares_used", "Times that a spare took a node's place", stood_in.clone());
        registry.register_with_unit("chunks_sent", "Geometry, textures and tables", Unit::Bytes, chunk_bytes.clone());

        let counter = |registry: &mut Registry, name: &str, help: &str| {
            let family = Family::<OfNode, Counter>::default();
            registry.register(name, help, family.clone());
            family
        };
        let passed_over = counter(&mut registry, "node_passed_over", "Frames that went on without the node");
        let frame_bytes = counter(&mut registry, "node_frame_bytes", "Bytes of frames sent to the node");
        let gauge = |registry: &mut Registry, name: &str, help: &str| {
            let family = Family::<OfNode, Gauge>::default();
            registry.register(name, help, family.clone());
            family
        };
        let draw_us = gauge(&mut registry, "node_draw_microseconds", "Time that the node took to draw its last frame");
        let leaves = gauge(&mut registry, "node_leaves", "Leaves that the node drew last");
        let triangles = gauge(&mut registry, "node_triangles", "Triangles that the node drew last");
        let resident_bytes = gauge(&mut registry, "node_resident_bytes", "Bytes of chunks in the node's memory");
        let of_node = |node: &mullion_common::wall::Node| {
            let label = OfNode { node: node.name.clone() };
            NodeMetrics {
                passed_over: passed_over.get_or_create_owned(&label),
                frame_bytes: frame_bytes.get_or_create_owned(&label),
                draw_us: draw_us.get_or_create_owned(&label),
                leaves: leaves.get_or_create_owned(&label),
                triangles: triangles.get_or_create_owned(&label),
                resident_bytes: resident_bytes.get_or_create_owned(&label),
            }
        };
        let metrics = Self {
            frames,
            stages: ["cull", "diff", "encode", "send"].map(|stage| stages.get_or_create_owned(&OfStage { stage })),
            waited,
            skew,
            connected,
            shown_by,
            dropped,
            budget,
            over_budget,
            joined,
            left,
            stood_in,
            chunk_bytes,
            chunk_bytes_before: 0,
            nodes: wall.nodes().iter().map(of_node).collect(),
            shown: [ShownAt::default(); SKEW_FRAMES],
        };
        (metrics, MetricsReader(registry))
    }

    /// Takes down a frame.
    pub fn note_frame(&mut self, frame: &FrameReport) {
        self.frames.inc();
        for (stage, time) in self.stages.iter().zip([frame.cull, frame.diff, frame.encode, frame.send]) {
            stage.observe(time.as_secs_f64());
        }
        self.waited.observe(frame.waited.as_secs_f64());
        self.connected.set(i64::from(frame.connected));
        self.shown_by.set(i64::from(frame.shown_by));
        self.dropped.set(i64::from(frame.dropped_objects));
        let limits = frame.spent.filter(|spent| !spent.is_complete);
        self.budget.set(limits.map_or(0, |spent| i64::from(spent.triangles)));
        self.over_budget.inc_by(u64::from(limits.is_some_and(|spent| spent.is_over)));
        self.chunk_bytes.inc_by(frame.chunk_bytes.saturating_sub(self.chunk_bytes_before));
        self.chunk_bytes_before = frame.chunk_bytes;
        for node in &frame.passed_over {
            self.nodes[usize::from(node.0)].passed_over.inc();
        }
        for ((node, bytes), stats) in self.nodes.iter().zip(&frame.frame_bytes).zip(&frame.node_stats) {
            node.frame_bytes.inc_by(u64::from(*bytes));
            node.draw_us.set(i64::from(stats.draw_us));
            node.leaves.set(i64::from(stats.leaves));
            node.triangles.set(i64::try_from(stats.triangles).unwrap_or(i64::MAX));
            node.resident_bytes.set(i64::try_from(stats.resident_bytes).unwrap_or(i64::MAX));
        }
    }

    /// Takes down that a node showed a frame.
    pub fn note_shown(&mut self, _: NodeIndex, shown: &Shown) {
        let place = &mut self.shown[(shown.frame % SKEW_FRAMES as u64) as usize];
        if place.frame > shown.frame {
            return; // long ago
        }
        if place.frame < shown.frame {
            if place.nodes > 1 {
                self.skew.observe(Duration::from_micros(place.last_us - place.first_us).as_secs_f64());
            }
            *place = ShownAt { frame: shown.frame, nodes: 0, first_us: u64::MAX, last_us: 0 };
        }
        place.nodes += 1;
        place.first_us = place.first_us.min(shown.at_us);
        place.last_us = place.last_us.max(shown.at_us);
    }

    /// Takes down that a node came or went.
    pub fn note_node(&mut self, event: &NodeEvent) {
        match event {
            NodeEvent::Joined { .. } => self.joined.inc(),
            NodeEvent::Left { .. } => self.left.inc(),
            NodeEvent::StoodIn { .. } => self.stood_in.inc(),
            NodeEvent::StandingBy { .. } | NodeEvent::TookOver { .. } | NodeEvent::SteppedBack { .. } => 0,
        };
    }
}

impl MetricsReader {
    /// The type of [`MetricsReader::text`], as HTTP names it.
    pub const CONTENT_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

    /// All of it in the OpenMetrics text format.
    pub fn text(&self) -> String {
        let mut out = String::new();
        // Writing to a string does not fail.
        text::encode(&mut out, &self.0).unwrap_or_default();
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::master::Spent;
    use mullion_common::wall::WallConfig;
    use mullion_common::wire::Stats;

    #[test]
    fn what_is_taken_down_is_told() {
        let text = "[grid]\ncolumns = 2\nrows = 1\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n";
        let (mut metrics, reader) = Metrics::new(&WallConfig::parse(text).unwrap());
        for number in 0..3 {
            let stats = Stats { draw_us: 1500, ..Stats::default() };
            metrics.note_frame(&FrameReport {
                number,
                cull: Duration::from_micros(300),
                frame_bytes: vec![100, 50],
                node_stats: vec![stats, Stats::default()],
                passed_over: if number == 1 { vec![NodeIndex(1)] } else { vec![] },
                connected: 2,
                dropped_objects: 7,
                spent: Some(Spent { triangles: 9000, is_over: number < 2, ..Spent::default() }),
                chunk_bytes: 1000 * number,
                ..FrameReport::default()
            });
        }
        for frame in [1, 2, 1 + SKEW_FRAMES as u64] {
            metrics.note_shown(NodeIndex(0), &Shown { frame, at_us: 1000 * frame });
            metrics.note_shown(NodeIndex(1), &Shown { frame, at_us: 1000 * frame + 500 });
        }
        metrics.note_shown(NodeIndex(1), &Shown { frame: 1, at_us: 9_000_000 });
        metrics.note_node(&NodeEvent::StoodIn { node: "t0x0".into(), spare: "attic".into() });
        let text = reader.text();
        for line in [
            "mullion_frames_total 3",
            "mullion_frame_stage_seconds_count{stage=\"cull\"} 3",
            "mullion_frame_stage_seconds_sum{stage=\"cull\"} 0.0009",
            "mullion_swap_skew_seconds_count 1",
            "mullion_swap_skew_seconds_sum 0.0005",
            "mullion_nodes_connected 2",
            "mullion_objects_dropped 7",
            "mullion_budget_triangles 9000",
            "mullion_frames_over_budget_total 2",
            "mullion_spares_used_total 1",
            "mullion_chunks_sent_bytes_total 2000",
            "mullion_node_passed_over_total{node=\"t1x0\"} 1",
            "mullion_node_frame_bytes_total{node=\"t0x0\"} 300",
            "mullion_node_draw_microseconds{node=\"t0x0\"} 1500",
        ] {
            assert!(text.lines().any(|l| l.starts_with(line)), "{line} in\n{text}");
        }
        let last = FIRST_BUCKET_S * BUCKET_STEP.powi(i32::from(BUCKETS) - 1);
        assert!((1.0..2.0).contains(&last), "the buckets reach {last} s");
    }
}
