//! The only place that talks to OpenGL: a context without a window, and safe names for what the peer does with it.
//!
//! libEGL is opened when a [`Context`] is asked for and every function is looked up by name, so the program neither
//! links to GL nor needs it to be built. The table is our own and not a crate's: it is forty functions, of which the
//! usual bindings lack the one that reversed depth stands on, `glClipControl`.
//!
//! A process has at most one context, and it stays with the thread that made it; so every call reaches the context that
//! its objects belong to. What could make the driver read outside of a buffer (vertex layouts, index ranges, the size of
//! a picture) is checked here, so that the rest of the crate is safe code.
#![expect(unsafe_code, reason = "a foreign library's functions")]

use bytemuck::{Pod, Zeroable};
use libloading::Library;
use std::ffi::{CStr, c_char, c_void};
use std::mem::ManuallyDrop;
use std::ops::Range;
use std::ptr;
use std::sync::atomic::{AtomicBool, Ordering};
use thiserror::Error;

/// Whether this process has made its context.
static TAKEN: AtomicBool = AtomicBool::new(false);

/// The shared libraries that EGL goes by.
const LIBRARIES: [&str; 2] = ["libEGL.so.1", "libEGL.so"];

/// Why there is no peer on this machine, or none for this picture.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum GlError {
    /// Nothing to open.
    #[error("libEGL can't be opened ({0}); install Mesa's EGL and software driver")]
    Library(String),
    /// The library or driver is too old.
    #[error("the driver has no function {0}")]
    Function(&'static str),
    /// A call to EGL that failed.
    #[error("EGL failed to {what} (error {code:#06x})")]
    Egl {
        /// What was wanted.
        what: &'static str,
        /// What `eglGetError` said.
        code: i32,
    },
    /// Another driver came first.
    #[error("the driver is {0:?} and not llvmpipe; set LIBGL_ALWAYS_SOFTWARE=1 and GALLIUM_DRIVER=llvmpipe")]
    NotLlvmpipe(String),
    /// A shader was refused: our mistake.
    #[error("a shader was refused: {0}")]
    Shader(String),
    /// No such target.
    #[error("no picture of {width}x{height} with {samples} samples: {why}")]
    Target {
        /// Pixels.
        width: u32,
        /// Pixels.
        height: u32,
        /// Samples.
        samples: u32,
        /// What the driver offers, or said.
        why: String,
    },
    /// A scene that doesn't fit.
    #[error("{0} vertices or indices are more than OpenGL counts")]
    TooMany(usize),
    /// The caller's mistake.
    #[error("this process has had its context")]
    Twice,
    /// An error that a call left behind.
    #[error("OpenGL error {0:#06x}")]
    Left(u32),
}

type Display = *mut c_void;

macro_rules! functions {
    ($table:ident { $($name:ident($($argument:ty),*) $(-> $result:ty)?;)* }) => {
        #[expect(non_snake_case, reason = "the names of the specification")]
        struct $table {
            $($name: unsafe extern "system" fn($($argument),*) $(-> $result)?,)*
        }

        impl $table {
            /// # Safety
            /// `address` gives null or the function of that name, with the specification's signature.
            unsafe fn load(address: impl Fn(&CStr) -> *const c_void) -> Result<Self, GlError> {
                Ok(Self { $($name: {
                    let name = concat!(stringify!($name), "\0");
                    let found = address(CStr::from_bytes_with_nul(name.as_bytes()).expect("one NUL, at the end"));
                    if found.is_null() {
                        return Err(GlError::Function(stringify!($name)));
                    }
                    // SAFETY: not null, and by this function's contract of this type.
                    unsafe {
                        std::mem::transmute::<*const c_void, unsafe extern "system" fn($($argument),*) $(-> $result)?>(found)
                    }
                },)* })
            }
        }
    };
}

// EGL 1.5 specification, headers egl.h. Attributes are pointer-sized in the calls that came with 1.5.
functions!(Egl {
    eglGetProcAddress(*const c_char) -> *const c_void;
    eglGetPlatformDisplay(u32, *mut c_void, *const isize) -> Display;
    eglInitialize(Display, *mut i32, *mut i32) -> u32;
    eglBindAPI(u32) -> u32;
    eglChooseConfig(Display, *const i32, *mut *mut c_void, i32, *mut i32) -> u32;
    eglCreateContext(Display, *mut c_void, *mut c_void, *const i32) -> *mut c_void;
    eglMakeCurrent(Display, *mut c_void, *mut c_void, *mut c_void) -> u32;
    eglTerminate(Display) -> u32;
    eglGetError() -> i32;
});

// OpenGL 4.5 core profile specification, headers glcorearb.h.
functions!(Gl {
    glGetString(u32) -> *const c_char;
    glGetIntegerv(u32, *mut i32);
    glGetError() -> u32;
    glEnable(u32);
    glDisable(u32);
    glDepthFunc(u32);
    glDepthMask(u8);
    glBlendFunc(u32, u32);
    glPolygonOffset(f32, f32);
    glClipControl(u32, u32);
    glViewport(i32, i32, i32, i32);
    glClearBufferfv(u32, i32, *const f32);
    glFinish();
    glCreateShader(u32) -> u32;
    glShaderSource(u32, i32, *const *const c_char, *const i32);
    glCompileShader(u32);
    glGetShaderiv(u32, u32, *mut i32);
    glGetShaderInfoLog(u32, i32, *mut i32, *mut c_char);
    glCreateProgram() -> u32;
    glAttachShader(u32, u32);
    glLinkProgram(u32);
    glGetProgramiv(u32, u32, *mut i32);
    glGetProgramInfoLog(u32, i32, *mut i32, *mut c_char);
    glUseProgram(u32);
    glGetUniformLocation(u32, *const c_char) -> i32;
    glUniform3f(i32, f32, f32, f32);
    glUniformMatrix4fv(i32, i32, u8, *const f32);
    glGenVertexArrays(i32, *mut u32);
    glBindVertexArray(u32);
    glGenBuffers(i32, *mut u32);
    glBindBuffer(u32, u32);
    glBufferData(u32, isize, *const c_void, u32);
    glEnableVertexAttribArray(u32);
    glVertexAttribPointer(u32, i32, u32, u8, i32, *const c_void);
    glDrawElements(u32, i32, u32, *const c_void);
    glGenFramebuffers(i32, *mut u32);
    glBindFramebuffer(u32, u32);
    glFramebufferRenderbuffer(u32, u32, u32, u32);
    glCheckFramebufferStatus(u32) -> u32;
    glBlitFramebuffer(i32, i32, i32, i32, i32, i32, i32, i32, u32, u32);
    glGenRenderbuffers(i32, *mut u32);
    glBindRenderbuffer(u32, u32);
    glRenderbufferStorageMultisample(u32, i32, u32, i32, i32);
    glReadPixels(i32, i32, i32, i32, u32, u32, *mut c_void);
});

/// A corner of a face, as the driver reads it.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Vertex {
    /// World, m.
    pub(crate) position: [f32; 3],
    /// Unit vector, world.
    pub(crate) normal: [f32; 3],
    /// Linear RGB and saturation, 65535 for 1: finer than any picture, and half of what floats would have to be fetched.
    pub(crate) color: [u16; 4],
}

/// A linked pair of shaders with the two uniforms that all of ours have.
#[derive(Debug)]
pub(crate) struct Program {
    id: u32,
    view_projection: i32,
    sun: i32,
}

/// Vertices and indices in the driver's memory.
#[derive(Debug)]
pub(crate) struct Geometry {
    id: u32,
    indices: u32,
}

/// What a pixel is kept as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    /// 8 bits a channel, linear: what is cheapest for the driver.
    Rgba8,
    /// 32-bit floats.
    Rgba32F,
}

/// A picture that can be drawn to, with 32-bit float depth.
#[derive(Debug)]
pub(crate) struct Target {
    /// What is drawn to.
    drawn: u32,
    /// Where the finished picture is: the same without multisampling.
    finished: u32,
    width: i32,
    height: i32,
    format: Format,
}

/// How faces are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct State {
    /// Whether faces are seen from behind.
    pub(crate) double_sided: bool,
    /// Coplanar layer: moved towards the eye by so many polygon offsets.
    pub(crate) layer: i32,
    /// Whether saturations count and depth is not written.
    pub(crate) blend: bool,
}

/// The process's OpenGL context, current on the thread that made it.
pub(crate) struct Context {
    egl: Egl,
    gl: Gl,
    display: Display,
    /// The driver's name.
    pub(crate) renderer: String,
    /// Most samples of a pixel.
    pub(crate) samples_max: u32,
    /// Keeps the functions of `egl` and `gl` where they are. Never closed: the driver's threads may still be at work when
    /// its display has been given back.
    _library: ManuallyDrop<Library>,
}

impl std::fmt::Debug for Context {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Context").field("renderer", &self.renderer).finish_non_exhaustive()
    }
}

impl Context {
    /// Opens the library and makes a context of OpenGL 4.5 that has no window.
    ///
    /// # Errors
    /// [`GlError`] when there is no such thing here, or it isn't llvmpipe.
    pub(crate) fn new() -> Result<Self, GlError> {
        if TAKEN.swap(true, Ordering::Relaxed) {
            return Err(GlError::Twice);
        }
        // SAFETY: loading Mesa's EGL runs its initialisers, which ask nothing of the caller.
        let mut opened = LIBRARIES.map(|name| unsafe { Library::new(name) }).into_iter();
        let first = opened.next().expect("two names");
        let library = first.or_else(|error| opened.find_map(Result::ok).ok_or(error));
        let library = library.map_err(|error| GlError::Library(error.to_string()))?;
        let exported = |name: &CStr| {
            // SAFETY: only the address is taken.
            let found = unsafe { library.get::<unsafe extern "system" fn()>(name.to_bytes_with_nul()) };
            found.map_or(ptr::null(), |symbol| *symbol as *const c_void)
        };
        // SAFETY: libEGL exports its functions by their names.
        let egl = unsafe { Egl::load(exported)? };
        let display = current_context(&egl)?;
        // SAFETY: the argument is a string; EGL 1.5 gives core functions too. Mesa gives non-null for names that it
        // doesn't know, but it knows all of these since 4.5, and the context is of 4.5.
        let gl = unsafe { Gl::load(|name| (egl.eglGetProcAddress)(name.as_ptr()))? };
        let mut context =
            Self { egl, gl, display, renderer: String::new(), samples_max: 0, _library: ManuallyDrop::new(library) };
        let mut samples = 0;
        // SAFETY: the context is current; the driver's strings are static and end with NUL.
        unsafe {
            let name = (context.gl.glGetString)(RENDERER);
            if !name.is_null() {
                context.renderer = CStr::from_ptr(name).to_string_lossy().into_owned();
            }
            (context.gl.glGetIntegerv)(MAX_SAMPLES, &raw mut samples);
            // Reversed depth: 1 at the near plane, 0 at infinity, with all the precision of a float.
            (context.gl.glClipControl)(LOWER_LEFT, ZERO_TO_ONE);
            (context.gl.glEnable)(DEPTH_TEST);
            (context.gl.glDepthFunc)(GREATER);
            (context.gl.glBlendFunc)(SRC_ALPHA, ONE_MINUS_SRC_ALPHA);
        }
        if !context.renderer.contains("llvmpipe") {
            return Err(GlError::NotLlvmpipe(context.renderer.clone()));
        }
        context.samples_max = samples.unsigned_abs();
        Ok(context)
    }

    /// Compiles and links. Both shaders know `view_projection` and `sun`; attributes are at the places that
    /// [`Self::geometry`] fills.
    pub(crate) fn program(&self, vertex: &str, fragment: &str) -> Result<Program, GlError> {
        let gl = &self.gl;
        // SAFETY: sources are given with their lengths, logs with the room there is; uniform names end with NUL.
        unsafe {
            let id = (gl.glCreateProgram)();
            for (kind, text) in [(VERTEX_SHADER, vertex), (FRAGMENT_SHADER, fragment)] {
                let shader = (gl.glCreateShader)(kind);
                let (start, length) = (text.as_ptr().cast::<c_char>(), size(text.len())?);
                (gl.glShaderSource)(shader, 1, &raw const start, &raw const length);
                (gl.glCompileShader)(shader);
                let mut is_good = 0;
                (gl.glGetShaderiv)(shader, COMPILE_STATUS, &raw mut is_good);
                if is_good == 0 {
                    return Err(shader_log(|room, used, text| (gl.glGetShaderInfoLog)(shader, room, used, text)));
                }
                (gl.glAttachShader)(id, shader);
            }
            (gl.glLinkProgram)(id);
            let mut is_good = 0;
            (gl.glGetProgramiv)(id, LINK_STATUS, &raw mut is_good);
            if is_good == 0 {
                return Err(shader_log(|room, used, text| (gl.glGetProgramInfoLog)(id, room, used, text)));
            }
            Ok(Program {
                id,
                view_projection: (gl.glGetUniformLocation)(id, c"view_projection".as_ptr()),
                sun: (gl.glGetUniformLocation)(id, c"sun".as_ptr()),
            })
        }
    }

    /// Gives the driver static geometry: position at attribute 0, normal at 1, colour at 2.
    ///
    /// # Panics
    /// If an index is beyond the vertices.
    pub(crate) fn geometry(&self, vertices: &[Vertex], indices: &[u32]) -> Result<Geometry, GlError> {
        assert!(indices.iter().all(|&i| (i as usize) < vertices.len()), "indices must be of vertices");
        const STRIDE: i32 = size_of::<Vertex>() as i32;
        let count = u32::try_from(size(indices.len())?).expect("a length is not negative");
        let (vertices, bytes): (&[u8], &[u8]) = (bytemuck::cast_slice(vertices), bytemuck::cast_slice(indices));
        let gl = &self.gl;
        let mut id = 0;
        let mut buffers = [0; 2];
        // SAFETY: buffers are given with their lengths, which the driver copies; the layout is that of `Vertex`.
        unsafe {
            (gl.glGenVertexArrays)(1, &raw mut id);
            (gl.glBindVertexArray)(id);
            (gl.glGenBuffers)(2, buffers.as_mut_ptr());
            for ((kind, buffer), data) in
                [ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER].into_iter().zip(buffers).zip([vertices, bytes])
            {
                let length = isize::try_from(data.len()).map_err(|_| GlError::TooMany(data.len()))?;
                (gl.glBindBuffer)(kind, buffer);
                (gl.glBufferData)(kind, length, data.as_ptr().cast(), STATIC_DRAW);
            }
            for (place, components, kind, normalized, offset) in [
                (0, 3, FLOAT, 0, std::mem::offset_of!(Vertex, position)),
                (1, 3, FLOAT, 0, std::mem::offset_of!(Vertex, normal)),
                (2, 4, UNSIGNED_SHORT, 1, std::mem::offset_of!(Vertex, color)),
            ] {
                (gl.glEnableVertexAttribArray)(place);
                (gl.glVertexAttribPointer)(
                    place,
                    components,
                    kind,
                    normalized,
                    STRIDE,
                    ptr::without_provenance(offset),
                );
            }
        }
        self.check()?;
        Ok(Geometry { id, indices: count })
    }

    /// A picture with `samples` samples a pixel; 0: no multisampling.
    pub(crate) fn target(&self, [width, height]: [u32; 2], samples: u32, format: Format) -> Result<Target, GlError> {
        let fail = |why: String| GlError::Target { width, height, samples, why };
        if samples > self.samples_max {
            return Err(fail(format!("{} offers at most {}", self.renderer, self.samples_max)));
        }
        let (w, h, n) = (size(width as usize)?, size(height as usize)?, size(samples as usize)?);
        let color = match format {
            Format::Rgba8 => RGBA8,
            Format::Rgba32F => RGBA32F,
        };
        let framebuffer = |attached: &[(u32, u32)], n: i32| {
            let gl = &self.gl;
            let mut id = 0;
            // SAFETY: each call writes one name; sizes are checked by the driver.
            unsafe {
                (gl.glGenFramebuffers)(1, &raw mut id);
                (gl.glBindFramebuffer)(FRAMEBUFFER, id);
                for &(place, kept_as) in attached {
                    let mut buffer = 0;
                    (gl.glGenRenderbuffers)(1, &raw mut buffer);
                    (gl.glBindRenderbuffer)(RENDERBUFFER, buffer);
                    (gl.glRenderbufferStorageMultisample)(RENDERBUFFER, n, kept_as, w, h);
                    (gl.glFramebufferRenderbuffer)(FRAMEBUFFER, place, RENDERBUFFER, buffer);
                }
                self.check().map_err(|error| fail(error.to_string()))?;
                match (gl.glCheckFramebufferStatus)(FRAMEBUFFER) {
                    FRAMEBUFFER_COMPLETE => Ok(id),
                    status => Err(fail(format!("framebuffer status {status:#06x}"))),
                }
            }
        };
        let drawn = framebuffer(&[(COLOR_ATTACHMENT0, color), (DEPTH_ATTACHMENT, DEPTH_COMPONENT32F)], n)?;
        let finished = if samples == 0 { drawn } else { framebuffer(&[(COLOR_ATTACHMENT0, color)], 0)? };
        Ok(Target { drawn, finished, width: w, height: h, format })
    }

    /// Begins a frame: everything is background, and what is drawn from now on goes to `target` by `program`.
    pub(crate) fn begin(&self, target: &Target, program: &Program, background: [f32; 3]) {
        let gl = &self.gl;
        let color = [background[0], background[1], background[2], 1.0];
        let depth = 0.0f32;
        // SAFETY: four floats for a colour, one for a depth.
        unsafe {
            (gl.glBindFramebuffer)(FRAMEBUFFER, target.drawn);
            (gl.glViewport)(0, 0, target.width, target.height);
            (gl.glDepthMask)(1);
            (gl.glClearBufferfv)(COLOR, 0, color.as_ptr());
            (gl.glClearBufferfv)(DEPTH, 0, &raw const depth);
            (gl.glUseProgram)(program.id);
        }
    }

    /// World → clip space (column-major) and the direction towards the sun, for the program in use.
    pub(crate) fn look(&self, program: &Program, view_projection: &[f32; 16], sun: [f32; 3]) {
        // SAFETY: one matrix of sixteen floats.
        unsafe {
            (self.gl.glUniformMatrix4fv)(program.view_projection, 1, 0, view_projection.as_ptr());
            (self.gl.glUniform3f)(program.sun, sun[0], sun[1], sun[2]);
        }
    }

    /// How the next faces are drawn.
    pub(crate) fn state(&self, state: State) {
        let gl = &self.gl;
        let switch = |what: u32, on: bool| {
            let call = if on { gl.glEnable } else { gl.glDisable };
            // SAFETY: takes no pointer.
            unsafe { call(what) }
        };
        switch(CULL_FACE, !state.double_sided);
        switch(BLEND, state.blend);
        switch(POLYGON_OFFSET_FILL, state.layer != 0);
        let layer = state.layer as f32;
        // SAFETY: take no pointers.
        unsafe {
            (gl.glDepthMask)(u8::from(!state.blend));
            (gl.glPolygonOffset)(layer, 16.0 * layer);
        }
    }

    /// Draws a stretch of the indices, three to a triangle.
    ///
    /// # Panics
    /// If it reaches beyond them.
    pub(crate) fn draw(&self, geometry: &Geometry, indices: Range<u32>) {
        assert!(indices.start <= indices.end && indices.end <= geometry.indices, "a stretch of the geometry's indices");
        let offset = indices.start as usize * size_of::<u32>();
        let count = i32::try_from(indices.end - indices.start).expect("Context::geometry counted them in i32");
        // SAFETY: within the index buffer, as just asserted; the indices are within the vertices, as asserted when they
        // were given.
        unsafe {
            (self.gl.glBindVertexArray)(geometry.id);
            (self.gl.glDrawElements)(TRIANGLES, count, UNSIGNED_INT, ptr::without_provenance(offset));
        }
    }

    /// Ends a frame: averages samples, and waits until the picture is in memory.
    pub(crate) fn end(&self, target: &Target) {
        let gl = &self.gl;
        // SAFETY: take no pointers; both framebuffers are of this size.
        unsafe {
            if target.finished != target.drawn {
                let (w, h) = (target.width, target.height);
                (gl.glBindFramebuffer)(DRAW_FRAMEBUFFER, target.finished);
                (gl.glBlitFramebuffer)(0, 0, w, h, 0, 0, w, h, COLOR_BUFFER_BIT, NEAREST);
            }
            (gl.glFinish)();
        }
    }

    /// The finished picture: linear RGB floats, row-major, the first row at the top.
    ///
    /// # Errors
    /// [`GlError::Left`] if anything went wrong since the last check.
    ///
    /// # Panics
    /// If the target doesn't keep floats.
    pub(crate) fn read(&self, target: &Target) -> Result<Vec<f32>, GlError> {
        assert_eq!(target.format, Format::Rgba32F, "pictures are read from targets that keep floats");
        let row = target.width.unsigned_abs() as usize * 3;
        let mut floats = vec![0.0f32; row * target.height.unsigned_abs() as usize];
        // SAFETY: width × height × 3 floats is what is read; rows of floats are aligned to 4 bytes, GL's default.
        unsafe {
            (self.gl.glBindFramebuffer)(READ_FRAMEBUFFER, target.finished);
            (self.gl.glReadPixels)(0, 0, target.width, target.height, RGB, FLOAT, floats.as_mut_ptr().cast());
        }
        self.check()?;
        Ok(floats.chunks_exact(row).rev().flatten().copied().collect())
    }

    /// Whether a call has gone wrong since the last time.
    pub(crate) fn check(&self) -> Result<(), GlError> {
        // SAFETY: takes nothing.
        match unsafe { (self.gl.glGetError)() } {
            0 => Ok(()),
            error => Err(GlError::Left(error)),
        }
    }
}

impl Drop for Context {
    fn drop(&mut self) {
        // SAFETY: the display is ours, and nothing of it is used afterwards.
        unsafe {
            (self.egl.eglMakeCurrent)(self.display, ptr::null_mut(), ptr::null_mut(), ptr::null_mut());
            (self.egl.eglTerminate)(self.display);
        }
    }
}

/// Makes a context of OpenGL 4.5 core on Mesa's display without a window system, current on this thread.
fn current_context(egl: &Egl) -> Result<Display, GlError> {
    // SAFETY: eglGetError takes nothing.
    let fail = |what| GlError::Egl { what, code: unsafe { (egl.eglGetError)() } };
    let wanted = [SURFACE_TYPE, PBUFFER_BIT, RENDERABLE_TYPE, OPENGL_BIT, NONE];
    let version = [MAJOR_VERSION, 4, MINOR_VERSION, 5, PROFILE_MASK, CORE_PROFILE_BIT, NONE];
    let (mut config, mut found) = (ptr::null_mut(), 0);
    // SAFETY: attribute lists end with NONE; out parameters are of the types that the specification says.
    unsafe {
        let display = (egl.eglGetPlatformDisplay)(PLATFORM_SURFACELESS_MESA, ptr::null_mut(), ptr::null());
        if display.is_null() || (egl.eglInitialize)(display, ptr::null_mut(), ptr::null_mut()) == 0 {
            return Err(fail("open a display without a window system"));
        }
        let chosen = (egl.eglBindAPI)(OPENGL_API) != 0
            && (egl.eglChooseConfig)(display, wanted.as_ptr(), &raw mut config, 1, &raw mut found) != 0
            && found > 0;
        if !chosen {
            return Err(fail("find a configuration for OpenGL"));
        }
        let context = (egl.eglCreateContext)(display, config, ptr::null_mut(), version.as_ptr());
        if context.is_null() || (egl.eglMakeCurrent)(display, ptr::null_mut(), ptr::null_mut(), context) == 0 {
            return Err(fail("make a context of OpenGL 4.5"));
        }
        Ok(display)
    }
}

/// What the compiler said.
fn shader_log(read: impl FnOnce(i32, *mut i32, *mut c_char)) -> GlError {
    const ROOM: i32 = 1024;
    let mut text = vec![0u8; ROOM as usize];
    let mut used = 0;
    read(ROOM, &raw mut used, text.as_mut_ptr().cast());
    text.truncate(used.clamp(0, ROOM) as usize);
    GlError::Shader(String::from_utf8_lossy(&text).trim().to_owned())
}

/// A length as OpenGL counts.
fn size(length: usize) -> Result<i32, GlError> {
    i32::try_from(length).map_err(|_| GlError::TooMany(length))
}

// Values of the registries (egl.xml, gl.xml).
const PLATFORM_SURFACELESS_MESA: u32 = 0x31DD;
const OPENGL_API: u32 = 0x30A2;
const SURFACE_TYPE: i32 = 0x3033;
const PBUFFER_BIT: i32 = 0x0001;
const RENDERABLE_TYPE: i32 = 0x3040;
const OPENGL_BIT: i32 = 0x0008;
const MAJOR_VERSION: i32 = 0x3098;
const MINOR_VERSION: i32 = 0x30FB;
const PROFILE_MASK: i32 = 0x30FD;
const CORE_PROFILE_BIT: i32 = 0x0001;
const NONE: i32 = 0x3038;

const RENDERER: u32 = 0x1F01;
const MAX_SAMPLES: u32 = 0x8D57;
const LOWER_LEFT: u32 = 0x8CA1;
const ZERO_TO_ONE: u32 = 0x935F;
const DEPTH_TEST: u32 = 0x0B71;
const CULL_FACE: u32 = 0x0B44;
const BLEND: u32 = 0x0BE2;
const POLYGON_OFFSET_FILL: u32 = 0x8037;
const GREATER: u32 = 0x0204;
const SRC_ALPHA: u32 = 0x0302;
const ONE_MINUS_SRC_ALPHA: u32 = 0x0303;
const VERTEX_SHADER: u32 = 0x8B31;
const FRAGMENT_SHADER: u32 = 0x8B30;
const COMPILE_STATUS: u32 = 0x8B81;
const LINK_STATUS: u32 = 0x8B82;
const ARRAY_BUFFER: u32 = 0x8892;
const ELEMENT_ARRAY_BUFFER: u32 = 0x8893;
const STATIC_DRAW: u32 = 0x88E4;
const TRIANGLES: u32 = 0x0004;
const UNSIGNED_INT: u32 = 0x1405;
const UNSIGNED_SHORT: u32 = 0x1403;
const FLOAT: u32 = 0x1406;
const RGB: u32 = 0x1907;
const RGBA8: u32 = 0x8058;
const RGBA32F: u32 = 0x8814;
const DEPTH_COMPONENT32F: u32 = 0x8CAC;
const COLOR: u32 = 0x1800;
const DEPTH: u32 = 0x1801;
const COLOR_BUFFER_BIT: u32 = 0x4000;
const NEAREST: u32 = 0x2600;
const FRAMEBUFFER: u32 = 0x8D40;
const READ_FRAMEBUFFER: u32 = 0x8CA8;
const DRAW_FRAMEBUFFER: u32 = 0x8CA9;
const RENDERBUFFER: u32 = 0x8D41;
const COLOR_ATTACHMENT0: u32 = 0x8CE0;
const DEPTH_ATTACHMENT: u32 = 0x8D00;
const FRAMEBUFFER_COMPLETE: u32 = 0x8CD5;
