//! What somebody must know to change anything at a console.

use std::fmt;

/// A secret for the console's controls. Only its hash is kept, so that it can't get into a log.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Token(blake3::Hash);

/// A token that could be guessed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the console's token has {0} characters; give at least {min}", min = Token::CHARACTERS_MIN)]
pub struct TokenError(usize);

impl Token {
    /// A shorter one is refused.
    pub const CHARACTERS_MIN: usize = 12;

    /// The token that is written so.
    ///
    /// # Errors
    /// [`TokenError`] if it is too short.
    pub fn new(text: &str) -> Result<Self, TokenError> {
        match text.chars().count() {
            short if short < Self::CHARACTERS_MIN => Err(TokenError(short)),
            _ => Ok(Self(blake3::hash(text.as_bytes()))),
        }
    }

    /// Whether somebody has said it. How long that takes tells nothing of how much of it was right.
    pub fn is(&self, said: &str) -> bool {
        // blake3 compares hashes in constant time.
        self.0 == blake3::hash(said.as_bytes())
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_only_itself_and_not_short() {
        let token = Token::new("correct horse").unwrap();
        assert!(token.is("correct horse"));
        assert!(!token.is("correct hors") && !token.is(""));
        assert_eq!(Token::new("hunter2"), Err(TokenError(7)));
        assert_eq!(format!("{token:?}"), "Token");
    }
}
