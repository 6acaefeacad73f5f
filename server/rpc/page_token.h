#pragma once

#include <cstdint>
#include <string>

/// Page tokens are "<sequence>-<fingerprint of the list's conditions>": where the next page begins, of the list that
/// the token was made for.
namespace saltus::server {

std::string make_page_token(std::int64_t before, const std::string& conditions_fingerprint);

/// The sequence number before which the page begins; "" is the first page of any list. Throws Refusal BAD_PAGE_TOKEN
/// for everything that make_page_token has not made of the same fingerprint.
std::int64_t parse_page_token(const std::string& token, const std::string& conditions_fingerprint);

}  // namespace saltus::server
