//! `mullion`: a culling service for tiled display walls, CAVEs and multi-projector rooms.

mod address;
mod birdseye;
mod camera;
mod commands;
mod composite;
mod cull_cases;
mod drawn;
mod files;
mod item_buffer;
mod load;
mod lod;
mod pixels;
mod plot;
mod plp;
mod progress;
mod say;
mod show;

use std::io::IsTerminal;
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Parser, Subcommand};

/// Culling service for tiled display walls, CAVEs and multi-projector rooms.
#[derive(Parser)]
#[command(name = "mullion", version, about, propagate_version = true)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Show a wall on this machine: master and tiles over real sockets, and a picture of the result.
    Demo(commands::demo::Options),
    /// Drive a wall: cull, stream and keep the tiles in step.
    Serve(commands::serve::Options),
    /// Cull a recorded show again, and compare what each view sees.
    Replay(commands::replay::Options),
    /// Be one node of a wall: draw its tiles.
    Tile(commands::tile::Options),
    /// Make certificates for a wall: one for its master, and one for each node.
    Enroll(commands::enroll::Options),
    /// Write one of the papers' scenes as a GLB file.
    Generate(commands::generate::Options),
    /// Turn a glTF or GLB scene into a package.
    Prepare(commands::prepare::Options),
    /// Tell what a scene amounts to.
    Info(commands::info::Options),
    /// Cull one frame without drawing, and write down what each tile may see.
    Cull(commands::cull::Options),
    /// Write a camera path for a scene.
    Path(commands::path::Options),
    /// Run a whole wall on this machine, and tell whether it keeps its time.
    Loadtest(commands::loadtest::Options),
    /// Be nodes of a wall that draw nothing.
    #[command(hide = true)]
    LoadNodes(commands::load_nodes::Options),
    /// Measure on this machine: the papers' tables and figures.
    Bench(commands::bench::Options),
    /// Prove on this machine that culling drops nothing and changes no picture.
    Verify(commands::verify::Options),
}

/// Exit code for whatever a user can mend: a file, an argument, a port.
const USER_ERROR: u8 = 2;

fn main() -> ExitCode {
    tracing_subscriber::fmt()
        .with_env_filter(
            tracing_subscriber::EnvFilter::try_from_env("MULLION_LOG")
                .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new("warn,wgpu_hal=error,wgpu_core=error")),
        )
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .with_span_events(tracing_subscriber::fmt::format::FmtSpan::CLOSE)
        .without_time()
        .init();
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) if error.use_stderr() && error.kind() != ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            eprintln!("mullion: {}", in_one_line(&error.render().to_string()));
            return ExitCode::from(USER_ERROR);
        }
        Err(help) => help.exit(),
    };
    let result = match arguments.command {
        Command::Demo(options) => commands::demo::run(&options),
        Command::Serve(options) => commands::serve::run(&options),
        Command::Replay(options) => commands::replay::run(&options),
        Command::Tile(options) => commands::tile::run(&options),
        Command::Enroll(options) => commands::enroll::run(&options),
        Command::Generate(options) => commands::generate::run(&options),
        Command::Prepare(options) => commands::prepare::run(&options),
        Command::Info(options) => commands::info::run(&options),
        Command::Cull(options) => commands::cull::run(&options),
        Command::Path(options) => commands::path::run(&options),
        Command::Loadtest(options) => commands::loadtest::run(&options),
        Command::LoadNodes(options) => commands::load_nodes::run(&options),
        Command::Bench(options) => commands::bench::run(&options),
        Command::Verify(options) => commands::verify::run(&options),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("mullion: {error:#}");
            ExitCode::from(USER_ERROR)
        }
    }
}

/// What clap says of wrong arguments, without the usage that it adds and the tip to pass options as values.
fn in_one_line(message: &str) -> String {
    let mut line = String::new();
    let told = message.lines().take_while(|l| !l.starts_with("Usage:") && !l.starts_with("For more information"));
    for part in told.map(|l| l.trim().trim_start_matches("error: ")).filter(|l| !l.is_empty() && !l.contains("as a value, use")) {
        line.push_str(if line.is_empty() || line.ends_with(':') { "" } else { ";" });
        line.push_str(if line.is_empty() { "" } else { " " });
        line.push_str(part);
    }
    line + " (--help tells more)"
}
