//! A way between two processes that a test can cut and mend.
#![allow(dead_code)] // each test uses its part

use std::io;
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;

/// Passes on connections to another address.
pub struct Relay {
    pub address: String,
    way: Arc<Way>,
}

#[derive(Default)]
struct Way {
    is_cut: AtomicBool,
    passed_on: AtomicUsize,
    open: Mutex<Vec<TcpStream>>,
}

impl Relay {
    pub fn to(target: String) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("it is bound").to_string();
        let way = Arc::new(Way::default());
        let of_thread = Arc::clone(&way);
        thread::spawn(move || {
            for from in listener.incoming().map_while(Result::ok) {
                // Where the way is cut, or the target is gone, the connection is closed.
                let _ = of_thread.pass_on(from, &target);
            }
        });
        Self { address, way }
    }

    /// Ends all connections, and makes no new ones.
    pub fn cut(&self) {
        let mut open = self.way.open.lock().expect("no panic in there");
        self.way.is_cut.store(true, Ordering::SeqCst);
        for stream in open.drain(..) {
            let _ = stream.shutdown(Shutdown::Both); // it ended already
        }
    }

    /// Makes connections again.
    pub fn mend(&self) {
        self.way.is_cut.store(false, Ordering::SeqCst);
    }

    /// How many connections were made so far.
    pub fn passed_on(&self) -> usize {
        self.way.passed_on.load(Ordering::SeqCst)
    }
}

impl Way {
    fn pass_on(&self, from: TcpStream, target: &str) -> io::Result<()> {
        let mut open = self.open.lock().expect("no panic in there");
        if self.is_cut.load(Ordering::SeqCst) {
            return Ok(());
        }
        let to = TcpStream::connect(target)?;
        self.passed_on.fetch_add(1, Ordering::SeqCst);
        for (read, write) in [(&from, &to), (&to, &from)] {
            let (mut read, mut write) = (read.try_clone()?, write.try_clone()?);
            read.set_nodelay(true)?;
            thread::spawn(move || {
                let _ = io::copy(&mut read, &mut write); // an end is an end
                let _ = write.shutdown(Shutdown::Write);
            });
        }
        open.extend([from, to]);
        Ok(())
    }
}
