//! `mullion enroll`: certificates for a wall.

use std::fs;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::{Context, Result, anyhow, bail};
use mullion_common::identity::{Bearer, IdentityFile, NodeIdentity};
use mullion_server::enroll::Authority;

use crate::files::{open_identity, open_wall};
use crate::say::say;

/// Which wall, and where its certificates go.
#[derive(clap::Args)]
pub struct Options {
    /// Wall file.
    wall: PathBuf,
    /// Folder for the wall's authority, master.pem, nodes/NAME.pem for each node, and what --spares and --standbys ask for. What is there
    /// already stays; a node whose tiles have changed gets a new file.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Make spares/spare-1.pem and so on for so many spares: a spare may take any missing node's place, but be no node of its own.
    #[arg(long, value_name = "COUNT", default_value_t = 0, value_parser = clap::value_parser!(u32).range(..=MAX_EXTRAS))]
    spares: u32,
    /// Make standbys/standby-1.pem and so on for so many masters that stand by, each with a key of its own.
    #[arg(long, value_name = "COUNT", default_value_t = 0, value_parser = clap::value_parser!(u32).range(..=MAX_EXTRAS))]
    standbys: u32,
    /// Make all certificates that are asked for anew, and overwrite what is there; only the authority stays.
    #[arg(long)]
    force: bool,
}

/// Most spares, and most standbys.
const MAX_EXTRAS: i64 = 1000;

/// An identity file that is to be.
struct Planned {
    bearer: Bearer,
    path: PathBuf,
    fate: Fate,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Fate {
    Kept,
    New,
    /// It was another one, or of other tiles.
    Replaced,
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let wall = open_wall(&options.wall)?;
    let now = SystemTime::now();
    let folder = &options.out;
    let make_folder = |name: &str| {
        let folder = folder.join(name);
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())
    };
    make_folder("nodes")?;
    (options.spares > 0).then(|| make_folder("spares")).transpose()?;
    (options.standbys > 0).then(|| make_folder("standbys")).transpose()?;
    let authority = open_authority(folder, now)?;
    let nodes = wall.nodes().iter().map(|node| {
        let path = folder.join("nodes").join(format!("{}.pem", node.name));
        (Bearer::Node(NodeIdentity::of(&wall, node)), path)
    });
    let spares = (1..=options.spares).map(|number| {
        let name = format!("spare-{number}");
        let path = folder.join("spares").join(format!("{name}.pem"));
        (Bearer::Spare(name), path)
    });
    let standbys = (1..=options.standbys).map(|number| {
        let path = folder.join("standbys").join(format!("standby-{number}.pem"));
        (Bearer::Master, path)
    });
    let all = std::iter::once((Bearer::Master, folder.join("master.pem"))).chain(nodes).chain(spares).chain(standbys);
    let plan: Vec<Planned> = all
        .map(|(bearer, path)| {
            let fate = if options.force { Fate::Replaced } else { fate(&authority, &bearer, &path)? };
            Ok(Planned { bearer, path, fate })
        })
        .collect::<Result<_>>()?;
    for Planned { bearer, path, fate } in &plan {
        if *fate != Fate::Kept {
            write_secret(&authority.issue(bearer, now)?, path)?;
        }
    }
    let count = |wanted: Fate| plan.iter().filter(|planned| planned.fate == wanted).count();
    let (new, replaced, kept) = (count(Fate::New), count(Fate::Replaced), count(Fate::Kept));
    say!("certificates in {}: {new} made, {replaced} replaced, {kept} kept", folder.display());
    for planned in plan.iter().filter(|planned| planned.fate == Fate::Replaced && !options.force) {
        say!("copy {} to its node again: its tiles have changed", planned.path.display());
    }
    say!("start the master with:  mullion serve WALL SCENE --listen ADDRESS --identity {}", plan[0].path.display());
    say!("copy one file to each node, and start it with:  mullion tile NAME --master HOST --identity NAME.pem");
    if options.spares > 0 {
        say!("start a spare with:  mullion tile spare-1 --spare --master HOST --identity spare-1.pem");
    }
    if options.standbys > 0 {
        say!("start a standby with:  mullion serve WALL SCENE --listen ADDRESS --standby-of HOST --identity standby-1.pem");
    }
    say!("keep {} where nobody else can read it", folder.join("authority.key").display());
    Ok(())
}

/// The authority of a folder, made where there is none.
fn open_authority(folder: &Path, now: SystemTime) -> Result<Authority> {
    let (certificate, key) = (folder.join("authority.pem"), folder.join("authority.key"));
    match (read(&certificate)?, read(&key)?) {
        (Some(certificate), Some(key)) => {
            Authority::read(&certificate, &key).map_err(|e| anyhow!("{}: {e}", folder.join("authority.pem").display()))
        }
        (None, None) => {
            let authority = Authority::new(now)?;
            write_secret(&authority.key_pem(), &key)?;
            write_secret(authority.certificate_pem(), &certificate)?;
            Ok(authority)
        }
        (Some(_), None) => bail!(missing(&key, &certificate)),
        (None, Some(_)) => bail!(missing(&certificate, &key)),
    }
}

fn missing(absent: &Path, present: &Path) -> String {
    let [absent, present] = [absent, present].map(Path::display);
    format!("{absent}: is not there, but {present} is: put it back, or enroll into another folder and copy all files anew")
}

fn read(path: &Path) -> Result<Option<String>> {
    match fs::read_to_string(path) {
        Ok(text) => Ok(Some(text)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error).with_context(|| path.display().to_string()),
    }
}

/// What becomes of a place. A file that this authority did not write for that bearer is somebody's, and stays.
fn fate(authority: &Authority, bearer: &Bearer, path: &Path) -> Result<Fate> {
    if !path.try_exists().with_context(|| path.display().to_string())? {
        return Ok(Fate::New);
    }
    let overwrite = "move it away, or overwrite it with --force";
    let IdentityFile { bearer: found, authority: signer, .. } = open_identity(path).map_err(|e| anyhow!("{e:#}: {overwrite}"))?;
    let shown = path.display();
    match (&found, bearer) {
        _ if signer != *authority.certificate() => bail!("{shown}: is of another authority: {overwrite}"),
        (found, bearer) if *found == *bearer => Ok(Fate::Kept),
        (Bearer::Node(found), Bearer::Node(node)) if found.name == node.name => Ok(Fate::Replaced),
        _ => bail!("{shown}: is for somebody else: {overwrite}"),
    }
}

/// Writes a file that only its owner may read, whole or not at all.
fn write_secret(text: &str, path: &Path) -> Result<()> {
    let write = || {
        let mut file = tempfile::NamedTempFile::new_in(path.parent().unwrap_or(Path::new(".")))?; // made with mode 0600
        file.write_all(text.as_bytes())?;
        file.persist(path)?;
        Ok(())
    };
    write().map_err(|error: std::io::Error| anyhow!("{}: {error}", path.display()))
}
