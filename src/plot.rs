//! Figures as SVG with real text: lines, and bars in groups. The only user of plotters.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, Ranged, ValueFormatter};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use thiserror::Error;

const SIZE_PX: (u32, u32) = (960, 540);
const LEGEND_PX: u32 = 170;
const FONT: &str = "sans-serif";
/// Most points drawn of a series: about two a pixel.
const MAX_POINTS: usize = 2000;
/// Colours that people tell apart whatever they see of colour (Okabe, Ito 2008); a ninth series begins anew.
const COLORS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
    RGBColor(150, 130, 20),
];

/// How values become lengths on the y axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// From 0.
    Linear,
    /// At least a decade; values of 0 and below are left out.
    Log,
}

/// What stands around a figure. Axis titles name the unit.
#[derive(Clone, Debug)]
pub struct Frame<'a> {
    pub title: &'a str,
    pub x_title: &'a str,
    pub y_title: &'a str,
    pub y_scale: Scale,
}

/// A line, or the bars of one colour.
#[derive(Clone, Debug)]
pub struct Series {
    pub name: String,
    /// Finite values: for lines the value at x = 0, 1, 2 …, for bars the value in each group.
    pub values: Vec<f64>,
}

/// Why a figure was not drawn.
#[derive(Debug, Error)]
#[error("the figure {title:?} cannot be drawn: {reason}")]
pub struct PlotError {
    title: String,
    reason: String,
}

/// The part of the picture that something is drawn on.
type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), Box<dyn std::error::Error>>;

/// A line for each series over x = 0, 1, 2 … Of long series runs of points become one, the greatest of them, so that no
/// peak is lost.
///
/// # Errors
/// When the library refuses.
pub fn lines(frame: &Frame<'_>, series: &[Series]) -> Result<String, PlotError> {
    let last = series.iter().map(|s| s.values.len()).max().unwrap_or(0).saturating_sub(1).max(1);
    let x = 0.0..last as f64;
    on_y_axis(frame, series, &|area, y| match y {
        YRange::Linear(y) => line_chart(area, frame, x.clone(), y, series),
        YRange::Log(y) => line_chart(area, frame, x.clone(), y.log_scale(), series),
    })
}

/// A group of bars for each name in `groups`, a bar of it for each series, its value above it.
///
/// # Errors
/// When the library refuses.
pub fn bars(frame: &Frame<'_>, groups: &[String], series: &[Series]) -> Result<String, PlotError> {
    on_y_axis(frame, series, &|area, y| match y {
        YRange::Linear(y) => bar_chart(area, frame, groups, (y.clone(), y.start), series),
        YRange::Log(y) => bar_chart(area, frame, groups, (y.clone().log_scale(), y.start), series),
    })
}

enum YRange {
    Linear(Range<f64>),
    Log(Range<f64>),
}

/// Draws a chart and its legend.
fn on_y_axis(frame: &Frame<'_>, series: &[Series], chart: &dyn Fn(&Area<'_>, YRange) -> Drawn) -> Result<String, PlotError> {
    let values = || series.iter().flat_map(|s| s.values.iter().copied()).filter(|v| v.is_finite());
    let highest = values().fold(0.0, f64::max);
    let lowest = values().filter(|v| *v > 0.0).fold(f64::INFINITY, f64::min);
    let y = match frame.y_scale {
        Scale::Linear => YRange::Linear(0.0..if highest > 0.0 { highest * 1.1 } else { 1.0 }),
        Scale::Log if lowest > highest => YRange::Log(1.0..10.0), // no value is above 0
        Scale::Log => {
            let decade = |v: f64| 10f64.powf(v.log10().floor());
            let bottom = (lowest / decade(lowest)).floor() * decade(lowest);
            let top = (highest / decade(highest)).ceil() * decade(highest);
            YRange::Log(bottom..top.max(bottom * 10.0))
        }
    };
    let mut svg = String::new();
    let draw = |svg: &mut String| -> Drawn {
        let whole = SVGBackend::with_string(svg, SIZE_PX).into_drawing_area();
        whole.fill(&WHITE)?;
        let (left, right) = whole.split_horizontally(SIZE_PX.0 - LEGEND_PX);
        chart(&left, y)?;
        legend(&right, series)?;
        Ok(whole.present()?)
    };
    let failed = |error: Box<dyn std::error::Error>| PlotError { title: frame.title.to_owned(), reason: error.to_string() };
    draw(&mut svg).map_err(failed)?;
    Ok(svg)
}

fn legend(area: &Area<'_>, series: &[Series]) -> Drawn {
    const TOP_PX: i32 = 56;
    const LINE_PX: i32 = 24;
    for ((series, color), row) in series.iter().zip(COLORS.iter().cycle()).zip(0..) {
        let y = TOP_PX + row * LINE_PX;
        area.draw(&Rectangle::new([(8, y - 6), (26, y + 6)], color.filled()))?;
        let style = (FONT, 15).into_font().color(&BLACK).pos(Pos::new(HPos::Left, VPos::Center));
        area.draw(&Text::new(series.name.clone(), (34, y), style))?;
    }
    Ok(())
}

fn line_chart<Y>(area: &Area<'_>, frame: &Frame<'_>, x: Range<f64>, y: Y, series: &[Series]) -> Drawn
where
    Y: AsRangedCoord<Value = f64>,
    Y::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let mut chart = builder(area, frame).build_cartesian_2d(x, y)?;
    let mut mesh = chart.configure_mesh();
    mesh.x_desc(frame.x_title).y_desc(frame.y_title).label_style((FONT, 14)).axis_desc_style((FONT, 15));
    mesh.x_label_formatter(&|v| number(*v)).y_label_formatter(&|v| number(*v));
    mesh.light_line_style(RGBColor(245, 245, 245)).bold_line_style(RGBColor(215, 215, 215)).draw()?;
    for (series, color) in series.iter().zip(COLORS.iter().cycle()) {
        let drawn = thinned(&series.values).filter(|(_, value)| frame.y_scale == Scale::Linear || *value > 0.0);
        chart.draw_series(LineSeries::new(drawn, color.stroke_width(2)))?;
    }
    Ok(())
}

fn bar_chart<Y>(area: &Area<'_>, frame: &Frame<'_>, groups: &[String], (y, bottom): (Y, f64), series: &[Series]) -> Drawn
where
    Y: AsRangedCoord<Value = f64>,
    Y::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    /// Share of a group's width that its bars take.
    const FILLED: f64 = 0.8;
    let mut chart = builder(area, frame).build_cartesian_2d(0.0..groups.len().max(1) as f64, y)?;
    let mut mesh = chart.configure_mesh();
    mesh.y_desc(frame.y_title).x_desc(frame.x_title).label_style((FONT, 14)).axis_desc_style((FONT, 15));
    mesh.disable_x_mesh().x_label_formatter(&|_| String::new()).y_label_formatter(&|v| number(*v));
    mesh.light_line_style(RGBColor(245, 245, 245)).bold_line_style(RGBColor(215, 215, 215)).draw()?;
    let text = |size: i32, anchor: VPos| (FONT, size).into_font().color(&BLACK).pos(Pos::new(HPos::Center, anchor));
    for (group, left) in groups.iter().zip(0..) {
        let name = Text::new(group.clone(), (0, 8), text(14, VPos::Top));
        chart.draw_series([EmptyElement::at((f64::from(left) + 0.5, bottom)) + name])?;
    }
    let width = FILLED / series.len().max(1) as f64;
    for ((series, color), place) in series.iter().zip(COLORS.iter().cycle()).zip(0..) {
        for (value, group) in series.values.iter().copied().zip(0..).filter(|(value, _)| *value > 0.0) {
            let left = f64::from(group) + (1.0 - FILLED) / 2.0 + f64::from(place) * width;
            chart.draw_series([Rectangle::new([(left, bottom), (left + width, value)], color.filled())])?;
            let label = Text::new(number(value), (0, -3), text(12, VPos::Bottom));
            chart.draw_series([EmptyElement::at((left + width / 2.0, value)) + label])?;
        }
    }
    Ok(())
}

fn builder<'a, 'b>(area: &'a Area<'b>, frame: &Frame<'_>) -> ChartBuilder<'a, 'b, SVGBackend<'b>> {
    let mut builder = ChartBuilder::on(area);
    builder.margin(12).caption(frame.title, (FONT, 18)).x_label_area_size(50).y_label_area_size(80);
    builder
}

/// Points of a line, at most [`MAX_POINTS`].
fn thinned(values: &[f64]) -> impl Iterator<Item = (f64, f64)> {
    let run = values.len().div_ceil(MAX_POINTS).max(1);
    values.chunks(run).zip(0..).map(move |(chunk, k)| {
        let greatest = chunk.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        ((k * run) as f64, greatest)
    })
}

/// Three digits and more where they count.
fn number(value: f64) -> String {
    match value.abs() {
        100.0.. => format!("{value:.0}"),
        10.0.. => format!("{value:.1}").trim_end_matches(".0").to_owned(),
        _ => format!("{value:.2}").trim_end_matches('0').trim_end_matches('.').to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series() -> Vec<Series> {
        let wave = |name: &str, scale: f64| {
            let values = (0..5000).map(|i| scale * (2.0 + (f64::from(i) * 0.01).sin())).collect();
            Series { name: name.to_owned(), values }
        };
        vec![wave("oh", 100.0), wave("sweep/2", 3.0), wave("a<b & \"c\"", 1000.0), wave("", 0.0)]
    }

    /// Tags close in the order in which they opened, and every `&` starts an entity.
    fn assert_well_formed(svg: &str) {
        let mut open = Vec::new();
        let mut rest = svg;
        while let Some((before, tag)) = rest.split_once('<') {
            let entity = |text: &str| ["amp;", "lt;", "gt;", "quot;", "apos;", "#"].iter().any(|e| text.starts_with(e));
            assert!(before.split('&').skip(1).all(entity), "{before}");
            let (tag, after) = tag.split_once('>').expect("it ends");
            assert!(!tag.contains('<'), "{tag}");
            match tag.strip_prefix('/') {
                Some(name) => assert_eq!(open.pop(), Some(name)),
                None if tag.ends_with('/') => {}
                None => open.push(tag.split_whitespace().next().expect("a name")),
            }
            rest = after;
        }
        assert!(open.is_empty() && rest.trim().is_empty(), "{open:?} {rest}");
    }

    #[test]
    fn figures_are_svg_with_text() {
        let series = series();
        for y_scale in [Scale::Linear, Scale::Log] {
            let frame = Frame { title: "culling & more", x_title: "frame", y_title: "cull time, µs", y_scale };
            let groups: Vec<String> = (1..=3).map(|n| format!("{n}x{n}")).collect();
            let few: Vec<Series> =
                series.iter().map(|s| Series { name: s.name.clone(), values: s.values[..3].to_vec() }).collect();
            for (svg, words) in [
                (lines(&frame, &series).expect("it can be drawn"), ["4000", "frame"]),
                (bars(&frame, &groups, &few).expect("it can be drawn"), ["1x1", "3x3"]),
            ] {
                assert_well_formed(&svg);
                assert!(svg.starts_with("<svg") && svg.len() < 400_000, "{} bytes", svg.len());
                let texts = ["sweep/2", "oh", "a&lt;b", "culling &amp; more", "cull time, µs"];
                for text in texts.into_iter().chain(words) {
                    assert!(svg.contains(text), "{text} is not in the figure");
                }
            }
        }
    }

    #[test]
    fn nothing_to_draw_is_drawn() {
        for y_scale in [Scale::Linear, Scale::Log] {
            let frame = Frame { title: "empty", x_title: "x", y_title: "y", y_scale };
            for series in [vec![], vec![Series { name: "none".into(), values: vec![] }]] {
                assert_well_formed(&lines(&frame, &series).expect("axes are drawn"));
                assert_well_formed(&bars(&frame, &[], &series).expect("axes are drawn"));
            }
        }
    }

    #[test]
    fn long_lines_keep_their_peaks() {
        let mut values = vec![1.0; 100_000];
        values[77_777] = 50.0;
        let drawn: Vec<_> = thinned(&values).collect();
        assert!(drawn.len() <= MAX_POINTS && drawn.iter().any(|(_, value)| *value == 50.0), "{}", drawn.len());
        assert_eq!([0.05, 3.0, 12.5, 40.0, 1234.5].map(number), ["0.05", "3", "12.5", "40", "1234"]);
    }
}
