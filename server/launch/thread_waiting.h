#pragma once

namespace saltus::server {

/// GOMP_SPINCOUNT of workers whose threads have cores of their own: so many turns a thread stays
/// awake for the next loop before it sleeps. Without, two threads took 9.4 to 11.3 s where one took 13.6 (thorax
/// 256x256x94); with it 8.2 to 8.8, and no less with more turns. Where other workers wait for the same core it only
/// takes their time: two such pairs at once on two cores took 19 s instead of 15 already with half as many.
inline constexpr const char* kBriefWait = "2000";

}  // namespace saltus::server
