//! The scenes that a standby holds: of the show as far as it was heard of, and of what is to come.

use std::future::pending;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use mullion_common::wire::{Insertion, Insertions, ToMaster};
use tokio::task::{JoinHandle, spawn_blocking};

use super::FreshScene;
use super::grown::Grown;
use crate::library::Library;

/// A scene that can be shown.
pub(super) struct Scene {
    pub grown: Grown,
    /// `None`: the show's own cull holds it.
    pub fresh: Option<Arc<FreshScene>>,
}

impl Scene {
    fn is(&self, insertions: &[Insertion]) -> bool {
        self.grown.insertions() == insertions
    }
}

/// A scene that could not be made.
struct Failure {
    insertions: Vec<Insertion>,
    /// The first that could not be followed to.
    epoch: u32,
    reason: String,
}

/// Whether a course is of a scene that is here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Entry {
    /// It is.
    Here,
    /// What is here is that scene before the last insertions: the course holds for it, but for objects that are not here.
    Behind,
    /// What is here is another scene.
    Apart,
}

/// Follows a master's insertions with packages of its own library.
pub(super) struct Scenes {
    packages: Option<Library>,
    /// What the show began with.
    first: Grown,
    /// Of the newest course.
    shown: Scene,
    next: Option<Scene>,
    /// What the master that is followed has said.
    wanted: Option<Insertions>,
    work: Option<JoinHandle<Result<Scene, Failure>>>,
    /// Nobody needs the work any more.
    is_over: Arc<AtomicBool>,
    /// What is wanted cannot be had.
    has_failed: bool,
    said: Option<u32>,
}

impl Scenes {
    /// `own`: what the show's own cull holds.
    pub fn new(first: &Grown, own: &Grown, library: Option<Library>) -> Self {
        let shown = Scene { grown: own.clone(), fresh: None };
        let (first, is_over) = (first.clone(), Arc::default());
        Self { packages: library, first, shown, next: None, wanted: None, work: None, is_over, has_failed: false, said: None }
    }

    /// A connection to a master begins.
    pub fn greet(&mut self) {
        (self.wanted, self.said) = (None, None);
    }

    /// The master says what its scene has grown by. What failed before is tried again.
    pub fn want(&mut self, insertions: Insertions) {
        (self.wanted, self.said, self.has_failed) = (Some(insertions), None, false);
    }

    /// The scene of the newest course.
    pub fn shown(&self) -> &Grown {
        &self.shown.grown
    }

    /// The end: what is shown. The rest takes time to be given back.
    pub fn into_shown(mut self) -> Scene {
        let grown = self.shown.grown.clone();
        let shown = std::mem::replace(&mut self.shown, Scene { grown, fresh: None });
        let _ = thread::Builder::new().name("retire".to_owned()).spawn(move || drop(self)); // without a thread, here and now
        shown
    }

    /// A course of that epoch came. `None`: nothing was said of such a scene.
    pub fn enter(&mut self, epoch: u32) -> Option<Entry> {
        let wanted = self.wanted.as_mut()?;
        let count = epoch.checked_sub(1)?;
        let insertions = wanted.list.get(..count as usize)?;
        wanted.entered = count;
        if let Some(next) = self.next.take_if(|next| next.is(insertions)) {
            self.shown = next;
        }
        Some(match insertions.strip_prefix(self.shown.grown.insertions()) {
            Some([]) => Entry::Here,
            Some(_) => Entry::Behind,
            None => Entry::Apart,
        })
    }

    /// What the master is to be told next. Nothing is lost where this is not awaited to its end.
    pub async fn answer(&mut self) -> ToMaster {
        loop {
            if let Some(epoch) = self.prepared().filter(|epoch| self.said != Some(*epoch)) {
                self.said = Some(epoch);
                return ToMaster::Prepared { epoch };
            }
            if self.work.is_none() && !self.has_failed {
                self.work = self.target().map(|insertions| self.start(insertions.to_vec()));
            }
            let Some(work) = &mut self.work else { return pending().await };
            let result = work.await;
            self.work = None;
            // Something else may be wanted meanwhile.
            let Some(target) = self.target() else { continue };
            let failed = |error| {
                let (insertions, epoch) = (target.to_vec(), 1 + target.len() as u32);
                Err(Failure { insertions, epoch, reason: format!("it failed: {error}") })
            };
            match result.unwrap_or_else(failed) {
                Ok(scene) if scene.is(target) => self.next = Some(scene),
                Err(failure) if failure.insertions == target => {
                    self.has_failed = true;
                    return ToMaster::unprepared(failure.epoch, failure.reason);
                }
                Ok(_) | Err(_) => {}
            }
        }
    }

    /// The insertions of the scene that the master shows, and those with the next one.
    fn of_master(&self) -> Option<(&[Insertion], &[Insertion])> {
        let wanted = self.wanted.as_ref()?;
        Some((&wanted.list[..wanted.entered as usize], &wanted.list))
    }

    /// The newest epoch that could be taken over.
    fn prepared(&self) -> Option<u32> {
        let (entered, all) = self.of_master()?;
        let is_next = |insertions| self.next.as_ref().is_some_and(|next| next.is(insertions));
        let count = match (self.shown.is(entered), is_next(entered), is_next(all)) {
            (true, _, true) => all.len(),
            (true, ..) | (_, true, _) => entered.len(),
            _ => return None,
        };
        Some(1 + count as u32)
    }

    /// What is to be prepared next.
    fn target(&self) -> Option<&[Insertion]> {
        let (entered, all) = self.of_master()?;
        match self.prepared() {
            None => Some(entered),
            // What comes next has its place once a course has told that the one before is shown.
            Some(epoch) if self.shown.is(entered) && (epoch as usize) <= all.len() => Some(all),
            Some(_) => None,
        }
    }

    fn start(&self, insertions: Vec<Insertion>) -> JoinHandle<Result<Scene, Failure>> {
        let is_part = |grown: &&Grown| insertions.starts_with(grown.insertions());
        let known = [self.next.as_ref().map(|next| &next.grown), Some(&self.shown.grown)];
        let from = known.into_iter().flatten().find(is_part).unwrap_or(&self.first).clone();
        let (library, is_over) = (self.packages.clone(), Arc::clone(&self.is_over));
        spawn_blocking(move || prepare(from, insertions, library.as_ref(), &is_over))
    }
}

impl Drop for Scenes {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
    }
}

fn prepare(
    mut grown: Grown,
    insertions: Vec<Insertion>,
    library: Option<&Library>,
    is_over: &AtomicBool,
) -> Result<Scene, Failure> {
    for count in grown.insertions().len()..insertions.len() {
        let joined = match is_over.load(Ordering::Relaxed) {
            true => Err("the standby has gone".to_owned()),
            false => grown.with(&insertions[count], library).map_err(|error| error.to_string()),
        };
        grown = match joined {
            Ok(grown) => grown,
            Err(reason) => return Err(Failure { insertions, epoch: count as u32 + 2, reason }),
        };
    }
    let fresh = FreshScene::new(Arc::clone(grown.package()), insertions);
    Ok(Scene { grown, fresh: Some(Arc::new(fresh)) })
}

#[cfg(test)]
mod tests {
    use futures_util::FutureExt;
    use mullion_common::scene::Package;

    use super::Entry::{Apart, Behind, Here};
    use super::*;
    use crate::library::content_hash;

    /// A library with packages a, b and c, of one empty object each.
    struct Stage {
        folder: tempfile::TempDir,
        runtime: tokio::runtime::Runtime,
    }

    impl Stage {
        fn new() -> Self {
            let folder = tempfile::tempdir().unwrap();
            let mut bytes = Vec::new();
            Package::default().write_to(&mut bytes).unwrap();
            ["a", "b", "c"].iter().for_each(|name| std::fs::write(folder.path().join(name), &bytes).unwrap());
            Self { folder, runtime: tokio::runtime::Builder::new_current_thread().build().unwrap() }
        }

        fn open(&self) -> Library {
            Library::open(self.folder.path()).unwrap()
        }

        /// A standby whose own scene has grown by these.
        fn standby(&self, own: &[&str]) -> Scenes {
            let first = Grown::new(Arc::default(), None).unwrap();
            let own = own.iter().fold(first.clone(), |grown, name| grown.with(&insertion(name), Some(&self.open())).unwrap());
            Scenes::new(&first, &own, Some(self.open()))
        }

        /// The next so many answers, and that there is none after them.
        fn answers(&self, scenes: &mut Scenes, count: usize) -> Vec<ToMaster> {
            let answers = (0..count).map(|_| self.runtime.block_on(scenes.answer())).collect();
            let after = self.runtime.block_on(async { scenes.answer().now_or_never() });
            assert!(after.is_none() && scenes.work.is_none(), "{after:?}");
            answers
        }
    }

    fn insertion(name: &str) -> Insertion {
        let hash = content_hash(&Package::default()).unwrap();
        Insertion { package: name.into(), hash, under: None, world_from_root: [1., 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0.] }
    }

    fn wanted(entered: u32, names: &[&str]) -> Insertions {
        Insertions { entered, list: names.iter().map(|name| insertion(name)).collect() }
    }

    fn prepared(epoch: u32) -> ToMaster {
        ToMaster::Prepared { epoch }
    }

    fn shown(scenes: &Scenes) -> (Vec<String>, bool) {
        let fresh = &scenes.shown.fresh;
        assert!(fresh.as_ref().is_none_or(|fresh| fresh.insertions() == scenes.shown().insertions()));
        (scenes.shown().insertions().iter().map(|insertion| insertion.package.clone()).collect(), fresh.is_some())
    }

    #[test]
    fn each_insertion_is_prepared_before_it_is_shown() {
        let stage = Stage::new();
        let mut scenes = stage.standby(&[]);
        scenes.greet();
        assert_eq!(stage.answers(&mut scenes, 0), []);
        assert_eq!(scenes.enter(1), None, "nothing is known of the master's scene");
        scenes.want(wanted(0, &[]));
        assert_eq!(stage.answers(&mut scenes, 1), [prepared(1)]);
        assert_eq!([0, 2, 1].map(|epoch| scenes.enter(epoch)), [None, None, Some(Here)]);
        scenes.want(wanted(0, &["a"]));
        assert_eq!(stage.answers(&mut scenes, 2), [prepared(1), prepared(2)]);
        assert_eq!(scenes.enter(1), Some(Here), "it may take a while before it is shown");
        assert_eq!(shown(&scenes), (vec![], false));
        assert_eq!([2, 3].map(|epoch| scenes.enter(epoch)), [Some(Here), None]);
        assert_eq!(shown(&scenes), (vec!["a".into()], true));
        // The next one comes before a course of the last: that one keeps its place until then.
        scenes.want(wanted(1, &["a", "b"]));
        assert_eq!(stage.answers(&mut scenes, 2), [prepared(2), prepared(3)]);
        scenes.want(wanted(2, &["a", "b", "c"]));
        assert_eq!(stage.answers(&mut scenes, 1), [prepared(3)]);
        assert_eq!(scenes.enter(3), Some(Here));
        assert_eq!(stage.answers(&mut scenes, 1), [prepared(4)]);
        assert_eq!(scenes.enter(4), Some(Here));
        assert_eq!(shown(&scenes).0, ["a", "b", "c"]);
        assert_eq!(scenes.shown().objects(), 3);
    }

    #[test]
    fn what_was_shown_before_it_came_is_caught_up_with() {
        let stage = Stage::new();
        let mut scenes = stage.standby(&[]);
        scenes.want(wanted(2, &["a", "b", "c"]));
        assert_eq!(scenes.enter(3), Some(Behind), "it could take over without them");
        assert_eq!(stage.answers(&mut scenes, 1), [prepared(3)]);
        assert_eq!(scenes.enter(3), Some(Here));
        assert_eq!(stage.answers(&mut scenes, 1), [prepared(4)]);
        // The next is shown before it is prepared, and the master is in no hurry.
        assert_eq!(scenes.enter(4), Some(Here));
        scenes.want(wanted(4, &["a", "b", "c", "a"]));
        assert_eq!(scenes.enter(5), Some(Behind));
        assert_eq!(stage.answers(&mut scenes, 1), [prepared(5)]);
        assert_eq!(scenes.enter(5), Some(Here));
        // A connection later, to one that has restarted.
        scenes.greet();
        scenes.want(wanted(2, &["a", "b"]));
        assert_eq!(scenes.enter(3), Some(Apart));
        assert_eq!(stage.answers(&mut scenes, 1), [prepared(3)]);
        assert_eq!(scenes.enter(3), Some(Here));
        assert_eq!(shown(&scenes).0, ["a", "b"]);
    }

    #[test]
    fn a_scene_that_grew_apart_is_made_anew() {
        let stage = Stage::new();
        let mut scenes = stage.standby(&["a", "b"]);
        scenes.want(wanted(2, &["a", "b"]));
        assert_eq!(stage.answers(&mut scenes, 1), [prepared(3)]);
        assert_eq!(scenes.enter(3), Some(Here));
        assert_eq!(shown(&scenes), (vec!["a".into(), "b".into()], false), "its own cull holds it");
        for (names, count) in [(&["a"][..], 2), (&["c"], 2), (&["a", "c"], 3), (&[], 1)] {
            let mut scenes = stage.standby(&["a", "b"]);
            scenes.want(wanted(count - 1, names));
            assert_eq!(scenes.enter(count), Some(Apart));
            assert_eq!(stage.answers(&mut scenes, 1), [prepared(count)]);
            assert_eq!(shown(&scenes).0, ["a", "b"], "its own, until it hears of the other");
            assert_eq!(scenes.enter(count), Some(Here));
            assert_eq!(shown(&scenes), (names.iter().map(|name| (*name).to_owned()).collect(), true));
            assert_eq!(scenes.shown().objects(), names.len());
        }
    }

    #[test]
    fn what_cannot_be_had_is_told_once_each_time_it_is_asked_for() {
        let stage = Stage::new();
        let mut scenes = stage.standby(&[]);
        for _ in 0..2 {
            scenes.want(wanted(0, &["none"]));
            let answers = stage.answers(&mut scenes, 2);
            let [ToMaster::Prepared { epoch: 1 }, ToMaster::Unprepared { epoch: 2, reason }] = &answers[..] else {
                panic!("{answers:?}")
            };
            assert!(reason.contains("package \"none\""), "{reason}");
        }
        assert_eq!(scenes.enter(1), Some(Here), "the show goes on");
        let mut another = wanted(0, &["a"]);
        another.list[0].hash.0[0] ^= 1;
        scenes.want(another);
        let answers = stage.answers(&mut scenes, 2);
        assert!(matches!(&answers[1], ToMaster::Unprepared { reason, .. } if reason.contains("another one")), "{answers:?}");
        scenes.want(wanted(2, &["a", "none"]));
        let answers = stage.answers(&mut scenes, 1);
        assert!(matches!(&answers[..], [ToMaster::Unprepared { epoch: 3, .. }]), "{answers:?}");
        let mut without = stage.standby(&[]);
        without.packages = None;
        without.want(wanted(0, &["a"]));
        let answers = stage.answers(&mut without, 2);
        assert!(matches!(&answers[1], ToMaster::Unprepared { reason, .. } if reason.contains("--library")), "{answers:?}");
    }

    #[test]
    fn what_is_no_longer_wanted_when_it_is_ready_counts_for_nothing() {
        let stage = Stage::new();
        let mut scenes = stage.standby(&[]);
        scenes.want(wanted(0, &["a"]));
        assert_eq!(stage.runtime.block_on(scenes.answer()), prepared(1));
        for on_the_way in ["a", "none"] {
            let context = stage.runtime.enter();
            scenes.work = Some(scenes.start(vec![insertion(on_the_way)]));
            drop(context);
            scenes.want(wanted(0, &["b"]));
            assert_eq!(stage.answers(&mut scenes, 2), [prepared(1), prepared(2)]);
            assert_eq!(scenes.next.take().map(|next| next.is(&[insertion("b")])), Some(true));
        }
    }
}
