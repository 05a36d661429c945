//! A window that shows tiles. It runs on the main thread; renderers draw on others and feed it.

use std::sync::Arc;

use thiserror::Error;
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::keyboard::{Key, NamedKey};
use winit::window::{Fullscreen, Window, WindowId};

use crate::gpu::{DisplayHandle, Gpu, PresentError, Presenter, Shown, TileRect};

/// How the window looks.
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub struct WindowOptions {
    pub title: String,
    /// Size of its inside, unless it covers the screen.
    pub size_px: [u32; 2],
    pub cover: Cover,
    pub tiles: Vec<TileRect>,
}

/// How much of the screen a window covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cover {
    /// Its own size.
    Window,
    /// All of the screen that it is on, without a frame.
    Screen,
}

/// Why there is no window.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum WindowError {
    #[error("no display to open a window on: {0}; without one, write pictures to a folder")]
    Display(String),
    #[error("the window does not open: {0}")]
    Open(String),
    #[error(transparent)]
    Present(#[from] PresentError),
}

/// The window was closed.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("the window was closed")]
pub struct WindowClosed;

#[derive(Debug)]
enum Feed {
    LayOut(Vec<TileRect>),
    Show(Shown),
    Close,
}

/// Feeds a window, from any thread.
#[derive(Clone, Debug)]
pub struct WindowFeed(EventLoopProxy<Feed>);

impl WindowFeed {
    /// Places the tiles, instead of where [`WindowOptions`] has them.
    ///
    /// # Errors
    /// When the window was closed.
    pub fn lay_out(&self, tiles: Vec<TileRect>) -> Result<(), WindowClosed> {
        self.0.send_event(Feed::LayOut(tiles)).map_err(|_| WindowClosed)
    }

    /// Shows a tile's latest picture.
    ///
    /// # Errors
    /// When the window was closed.
    pub fn show(&self, shown: Shown) -> Result<(), WindowClosed> {
        self.0.send_event(Feed::Show(shown)).map_err(|_| WindowClosed)
    }

    /// Closes the window. It may be closed already.
    pub fn close(&self) {
        let _ = self.0.send_event(Feed::Close);
    }
}

/// A connection to the display, before there is a GPU or a window. At most one in a process.
pub struct Display(EventLoop<Feed>);

impl Display {
    /// Connects. On the main thread only.
    ///
    /// # Errors
    /// When there is no display.
    pub fn open() -> Result<Self, WindowError> {
        let built = EventLoop::<Feed>::with_user_event().build();
        built.map(Self).map_err(|e| WindowError::Display(e.to_string()))
    }

    /// For [`crate::gpu::GpuOptions`].
    pub fn handle(&self) -> DisplayHandle {
        Box::new(self.0.owned_display_handle())
    }

    /// What feeds the window.
    pub fn feed(&self) -> WindowFeed {
        WindowFeed(self.0.create_proxy())
    }

    /// Opens the window and shows what it is fed, until it is closed: by its feed, by the user, by Escape or `q`.
    ///
    /// # Errors
    /// When the window or its surface cannot be made or is lost.
    pub fn run(self, gpu: Arc<Gpu>, options: WindowOptions) -> Result<(), WindowError> {
        self.0.set_control_flow(ControlFlow::Wait);
        let mut app = App { gpu, options, open: None, early: Vec::new(), failed: None };
        self.0.run_app(&mut app).map_err(|e| WindowError::Display(e.to_string()))?;
        app.failed.map_or(Ok(()), Err)
    }
}

struct App {
    gpu: Arc<Gpu>,
    options: WindowOptions,
    open: Option<(Arc<Window>, Presenter)>,
    /// Shown before the window was open.
    early: Vec<Shown>,
    failed: Option<WindowError>,
}

impl App {
    fn open(&self, event_loop: &ActiveEventLoop) -> Result<(Arc<Window>, Presenter), WindowError> {
        let [width, height] = self.options.size_px;
        let mut attributes =
            Window::default_attributes().with_title(&self.options.title).with_inner_size(PhysicalSize::new(width, height));
        if self.options.cover == Cover::Screen {
            let screen = event_loop.primary_monitor().or_else(|| event_loop.available_monitors().next());
            attributes = attributes.with_decorations(false).with_fullscreen(Some(Fullscreen::Borderless(screen.clone())));
            if let Some(screen) = screen {
                // Display nodes often run without a window manager, and then nobody grants the wish above.
                attributes = attributes.with_inner_size(screen.size()).with_position(screen.position());
            }
        }
        let window = event_loop.create_window(attributes).map_err(|e| WindowError::Open(e.to_string()))?;
        let window = Arc::new(window);
        let size = window.inner_size();
        let tiles = self.options.tiles.clone();
        let presenter = Presenter::new(Arc::clone(&self.gpu), Arc::clone(&window), [size.width, size.height], tiles)?;
        Ok((window, presenter))
    }

    fn fail(&mut self, event_loop: &ActiveEventLoop, error: WindowError) {
        self.failed.get_or_insert(error);
        event_loop.exit();
    }
}

impl ApplicationHandler<Feed> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.open.is_some() {
            return;
        }
        match self.open(event_loop) {
            Ok((window, mut presenter)) => {
                self.early.drain(..).for_each(|shown| presenter.update(&shown));
                window.request_redraw();
                self.open = Some((window, presenter));
            }
            Err(error) => self.fail(event_loop, error),
        }
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, feed: Feed) {
        match (feed, &mut self.open) {
            (Feed::Close, _) => event_loop.exit(),
            (Feed::LayOut(tiles), open) => {
                self.options.tiles.clone_from(&tiles);
                if let Some((window, presenter)) = open {
                    presenter.lay_out(tiles);
                    window.request_redraw();
                }
            }
            (Feed::Show(shown), Some((window, presenter))) => {
                presenter.update(&shown);
                window.request_redraw();
            }
            (Feed::Show(shown), None) => {
                self.early.retain(|earlier| earlier.view != shown.view);
                self.early.push(shown);
            }
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some((window, presenter)) = &mut self.open else { return };
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::KeyboardInput { event, .. } if event.state.is_pressed() => match event.logical_key.as_ref() {
                Key::Named(NamedKey::Escape) | Key::Character("q") => event_loop.exit(),
                _ => {}
            },
            WindowEvent::Resized(size) => {
                presenter.resize([size.width, size.height]);
                window.request_redraw();
            }
            WindowEvent::RedrawRequested => {
                if let Err(error) = presenter.present() {
                    self.fail(event_loop, error.into());
                }
            }
            _ => {}
        }
    }

    /// The surface goes before the connection to the display does.
    fn exiting(&mut self, _: &ActiveEventLoop) {
        self.open = None;
    }
}
