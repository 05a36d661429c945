//! The scenes that a standby holds: of the show as far as it was heard of, and of what is to come.

use std::future::pending;
use std::sync::Arc;

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

/// Which epoch cannot be followed to, and why.
type Failure = (u32, String);

/// Follows a master's insertions with packages of its own library.
pub(super) struct Scenes {
    library: Option<Library>,
    /// What the show began with.
    first: Grown,
    /// Of the newest course.
    shown: Scene,
    next: Option<Scene>,
    /// What the master that is followed has said.
    wanted: Option<Insertions>,
    work: Option<JoinHandle<Result<Scene, Failure>>>,
    /// What is wanted cannot be had.
    has_failed: bool,
    said: Option<u32>,
}

impl Scenes {
    /// `own`: what the show's own cull holds.
    pub fn new(first: &Grown, own: &Grown, library: Option<Library>) -> Self {
        let shown = Scene { grown: own.clone(), fresh: None };
        Self { library, first: first.clone(), shown, next: None, wanted: None, work: None, has_failed: false, said: None }
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

    pub fn into_shown(self) -> Scene {
        self.shown
    }

    /// A course of that epoch came. Whether its scene is there.
    pub fn enter(&mut self, epoch: u32) -> bool {
        let Some(wanted) = &mut self.wanted else { return false };
        let count = epoch.wrapping_sub(1);
        let Some(insertions) = wanted.list.get(..count as usize) else { return false };
        if !self.shown.is(insertions) {
            let Some(next) = self.next.take_if(|next| next.is(insertions)) else { return false };
            self.shown = next;
        }
        wanted.entered = count;
        true
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
            let result = result.unwrap_or_else(|error| Err((1 + target.len() as u32, format!("it failed: {error}"))));
            match result {
                Ok(scene) if scene.is(target) => self.next = Some(scene),
                Ok(_) => {}
                Err((epoch, reason)) => {
                    self.has_failed = true;
                    return ToMaster::unprepared(epoch, reason);
                }
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
        let library = self.library.clone();
        spawn_blocking(move || prepare(from, insertions, library.as_ref()))
    }
}

fn prepare(mut grown: Grown, insertions: Vec<Insertion>, library: Option<&Library>) -> Result<Scene, Failure> {
    for (count, insertion) in insertions.iter().enumerate().skip(grown.insertions().len()) {
        grown = grown.with(insertion, library).map_err(|reason| (count as u32 + 2, reason))?;
    }
    let fresh = FreshScene::new(Arc::clone(grown.package()), insertions);
    Ok(Scene { grown, fresh: Some(Arc::new(fresh)) })
}

#[cfg(test)]
mod tests {
    use futures_util::FutureExt;
    use mullion_common::scene::Package;

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

        fn library(&self) -> Library {
            Library::open(self.folder.path()).unwrap()
        }

        /// A standby whose own scene has grown by these.
        fn standby(&self, own: &[&str]) -> Scenes {
            let first = Grown::new(Arc::default()).unwrap();
            let own = own.iter().fold(first.clone(), |grown, name| grown.with(&insertion(name), Some(&self.library())).unwrap());
            Scenes::new(&first, &own, Some(self.library()))
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
        assert!(!scenes.enter(1), "nothing is known of the master's scene");
        scenes.want(wanted(0, &[]));
        assert_eq!(stage.answers(&mut scenes, 1), [prepared(1)]);
        assert!(scenes.enter(1) && !scenes.enter(2) && !scenes.enter(0));
        scenes.want(wanted(0, &["a"]));
        assert_eq!(stage.answers(&mut scenes, 2), [prepared(1), prepared(2)]);
        assert!(scenes.enter(1), "it may take a while before it is shown");
        assert_eq!(shown(&scenes), (vec![], false));
        assert!(scenes.enter(2) && !scenes.enter(3));
        assert_eq!(shown(&scenes), (vec!["a".into()], true));
        // The next one comes before a course of the last: that one keeps its place until then.
        scenes.want(wanted(1, &["a", "b"]));
        assert_eq!(stage.answers(&mut scenes, 2), [prepared(2), prepared(3)]);
        scenes.want(wanted(2, &["a", "b", "c"]));
        assert_eq!(stage.answers(&mut scenes, 1), [prepared(3)]);
        assert!(scenes.enter(3));
        assert_eq!(stage.answers(&mut scenes, 1), [prepared(4)]);
        assert!(scenes.enter(4));
        assert_eq!(shown(&scenes).0, ["a", "b", "c"]);
        assert_eq!(scenes.shown().objects(), 3);
    }

    #[test]
    fn what_was_shown_before_it_came_is_caught_up_with() {
        let stage = Stage::new();
        let mut scenes = stage.standby(&[]);
        scenes.want(wanted(2, &["a", "b", "c"]));
        assert_eq!(stage.answers(&mut scenes, 1), [prepared(3)]);
        assert!(!scenes.enter(2) && scenes.enter(3));
        assert_eq!(stage.answers(&mut scenes, 1), [prepared(4)]);
        // A connection later.
        scenes.greet();
        scenes.want(wanted(2, &["a", "b"]));
        assert_eq!(stage.answers(&mut scenes, 1), [prepared(3)]);
        assert_eq!(shown(&scenes).0, ["a", "b"]);
    }

    #[test]
    fn a_scene_that_grew_apart_is_made_anew() {
        let stage = Stage::new();
        let mut scenes = stage.standby(&["a", "b"]);
        scenes.want(wanted(2, &["a", "b"]));
        assert_eq!(stage.answers(&mut scenes, 1), [prepared(3)]);
        assert!(scenes.enter(3));
        assert_eq!(shown(&scenes), (vec!["a".into(), "b".into()], false), "its own cull holds it");
        for (names, count) in [(&["a"][..], 2), (&["c"], 2), (&["a", "c"], 3), (&[], 1)] {
            let mut scenes = stage.standby(&["a", "b"]);
            scenes.want(wanted(count - 1, names));
            assert_eq!(stage.answers(&mut scenes, 1), [prepared(count)]);
            assert_eq!(shown(&scenes).0, ["a", "b"], "its own, until it hears of the other");
            assert!(scenes.enter(count));
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
        assert!(scenes.enter(1), "the show goes on");
        let mut another = wanted(0, &["a"]);
        another.list[0].hash.0[0] ^= 1;
        scenes.want(another);
        let answers = stage.answers(&mut scenes, 2);
        assert!(matches!(&answers[1], ToMaster::Unprepared { reason, .. } if reason.contains("another one")), "{answers:?}");
        scenes.want(wanted(2, &["a", "none"]));
        let answers = stage.answers(&mut scenes, 1);
        assert!(matches!(&answers[..], [ToMaster::Unprepared { epoch: 3, .. }]), "{answers:?}");
        let mut without = Scenes { library: None, ..stage.standby(&[]) };
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
        assert_eq!(stage.runtime.block_on(async { scenes.answer().now_or_never() }), None, "it works on it");
        scenes.want(wanted(0, &["b"]));
        assert_eq!(stage.answers(&mut scenes, 2), [prepared(1), prepared(2)]);
        assert!(scenes.enter(2));
        assert_eq!(shown(&scenes).0, ["b"]);
    }
}
