//! Every bound on what a peer may make us reserve, with the arithmetic that connects them.

/// Largest side of a view, pixels.
pub const VIEW_SIZE_MAX: u32 = 16_384;
/// Largest side of the stitched picture, pixels.
pub const STITCHED_SIZE_MAX: u32 = 65_535;
/// Most views of a rig.
pub const VIEWS_MAX: usize = 64;
/// Most stages that a board says of a frame: six of each view, and one before and after all.
pub const STAGE_SPANS_MAX: usize = 6 * VIEWS_MAX + 2;
/// Most boards in the row.
pub const BOARDS_MAX: usize = 256;
/// Most compositors: one of the whole picture, and two displays for each view.
pub const COMPOSITORS_MAX: usize = 2 * VIEWS_MAX + 1;
/// Most objects of a scene.
pub const OBJECTS_MAX: usize = 16_000_000;
/// Most subobjects of a scene.
pub const SUBOBJECTS_MAX: usize = 64_000_000;
/// Most nodes of a scene that is baked: every object, and as many nodes that only place others.
pub const NODES_MAX: usize = 2 * OBJECTS_MAX;
/// Most meshes that a baked scene keeps, its materials, and its textures: nothing of them is more than the objects could show.
pub const CONTENTS_MAX: usize = OBJECTS_MAX;
/// Most bytes of names and warnings in a baked scene.
pub const TEXT_MAX: usize = 1 << 30;
/// Most bytes of all meshes, and of all textures, in a baked scene. They are not read at once.
pub const BAKED_BYTES_MAX: u64 = 1 << 42;
/// Most triangles of one subobject: small enough that a list can drop or reorder it as one piece of work.
pub const TRIANGLES_PER_SUBOBJECT_MAX: usize = 2048;
/// Models of a scene: what merges its layers or has levels of detail. A frame names as many at most.
pub const MODELS_MAX: usize = 100_000;
/// Most versions of a model.
pub const VERSIONS_MAX: usize = 16;
/// Most lights of a scene.
pub const LIGHTS_MAX: usize = 4096;
/// Largest side of a texture, texels.
pub const TEXTURE_SIZE_MAX: u32 = 16_384;
/// Most entities that one frame moves.
pub const MOVED_MAX: usize = 100_000;
/// Largest control message, bytes.
pub const CONTROL_MESSAGE_MAX: usize = 1 << 20;
/// Largest preview picture that a compositor sends, bytes.
pub const PREVIEW_MAX: usize = 16 << 20;
/// Bytes that the claim of a length alone can make us reserve; a larger message's memory grows with what has come of it.
/// A view of 1080p in 8 bits fits.
pub const CLAIM_MAX: usize = 8 << 20;
/// Peers connected at once to one daemon, greeted or not.
pub const CONNECTIONS_MAX: usize = BOARDS_MAX + COMPOSITORS_MAX + 64;
/// Of these, from one address: a whole rig on one machine.
pub const CONNECTIONS_PER_ADDRESS_MAX: usize = BOARDS_MAX + COMPOSITORS_MAX + 8;
/// Peers of one address that have not said who they are. One more ends the oldest of them: honest ones need
/// milliseconds, so a peer that stalls keeps nobody out.
pub const GREETINGS_PER_ADDRESS_MAX: usize = 128;
/// Likewise, of all addresses.
pub const GREETINGS_MAX: usize = 192;
/// New connections that one address may make a second, in the long run: each costs a handshake, about a millisecond.
pub const CONNECTIONS_PER_SECOND_MAX: u32 = 64;
/// And at once, when it has made none for a while: all boards of a machine, and each again.
pub const CONNECTIONS_BURST_MAX: u32 = 2 * CONNECTIONS_PER_ADDRESS_MAX as u32;
/// Addresses that connections are counted for. One that has made none for a few seconds is forgotten.
pub const ADDRESSES_MAX: usize = 4096;
/// Longest name in a certificate: a label of the domain name system.
pub const NODE_NAME_MAX: usize = 63;
/// Largest file of certificates or keys, bytes.
pub const KEY_FILE_MAX: u64 = 1 << 20;
/// Largest bulk message (a mesh, a texture, a table slice, a run of tiles), bytes.
pub const BULK_MESSAGE_MAX: usize = 1 << 28;
/// Bytes of pieces that may be on their way to a board, sent and not yet confirmed; a single larger piece may too. A frame
/// waits behind them at most: at a gigabit a second four milliseconds.
pub const PIECES_IN_FLIGHT_MAX: u64 = 512 << 10;
/// Most names of pieces in one message from a board.
pub const PIECE_NAMES_MAX: usize = 60_000;
/// Longest name of a board, node or host that travels, bytes.
pub const NAME_MAX: usize = 256;
/// Most models in one native pose packet.
pub const POSE_MODELS_MAX: usize = 64;
/// Most entities in one native pose packet.
pub const POSE_ENTITIES_MAX: usize = 512;

const _: () = assert!(
    (TEXTURE_SIZE_MAX as u64) * (TEXTURE_SIZE_MAX as u64) * 4 >= BULK_MESSAGE_MAX as u64,
    "the message limit, not the side limit, bounds a texture's memory"
);
const _: () = assert!(CONNECTIONS_PER_ADDRESS_MAX < CONNECTIONS_MAX, "one address can't take all places");
const _: () = assert!(GREETINGS_PER_ADDRESS_MAX < GREETINGS_MAX && GREETINGS_MAX <= CONNECTIONS_MAX, "likewise");
const _: () = assert!(PIECE_NAMES_MAX * 16 + 1024 <= CONTROL_MESSAGE_MAX, "boards send control messages only");
